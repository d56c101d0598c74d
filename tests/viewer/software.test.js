// Which renderers count as software.

import assert from "node:assert/strict";
import { test } from "node:test";

import { isSoftware } from "../../rcmqp/show/viewer/assets/software.js";

test("software that draws is known by the names that browsers give it", () => {
  for (const name of [
    "ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero) (0x0000C0DE)), SwiftShader driver)",
    "llvmpipe (LLVM 15.0.7, 256 bits)", "Mesa/X.org, llvmpipe (LLVM 17.0.6)", "softpipe", "Microsoft Basic Render Driver", "Apple Software Renderer",
  ]) assert.ok(isSoftware(name), name);
  for (const name of ["ANGLE (Intel, Mesa Intel(R) UHD Graphics 620 (KBL GT2), OpenGL 4.6)", "NVIDIA GeForce RTX 3060/PCIe/SSE2", "Apple M2", "null", ""])
    assert.ok(!isSoftware(name), name);
});
