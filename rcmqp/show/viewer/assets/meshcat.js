// Meshcat's viewer and the three.js in it, which the page carries.

import { runLibrary } from "./packed.js";

await runLibrary("meshcat-gz");
export const { THREE, Viewer } = MeshCat;
