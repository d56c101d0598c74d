// Devices beside pointer and keys, each with a button on the page where the browser can use it.

import { query } from "./elements.js";
import { Gamepad } from "./gamepad.js";
import { Haply } from "./haply.js";
import { Headset } from "./headset.js";
import { SpaceMouse } from "./spacemouse.js";

/** What to say of a device. @param {string} words */
function say(words) {
  query(document, "#device").textContent = words;
}

/**
 * Show the button of a device.
 *
 * @param {string} id
 * @param {() => Promise<void> | void} connect
 */
function offer(id, connect) {
  const button = query(document, `#${id}`);
  button.hidden = false;
  button.addEventListener("click", async () => {
    say("");
    try {
      await connect();
    } catch (error) {
      say(error instanceof Error ? error.message : String(error));
    }
  });
}

export class Devices {
  /**
   * @param {import("./hands.js").Hand} hand
   * @param {import("./headset.js").Seen & {viscosity: () => number}} page with the viscosity to be felt [N s/m]
   */
  constructor(hand, page) {
    this.hand = hand;
    this.gamepad = new Gamepad(hand);
    this.spaceMouse = new SpaceMouse(hand, page.changed);
    this.haply = new Haply(hand, { ...page, said: say });
    const { hid, xr } = /** @type {{hid?: import("./spacemouse.js").Hid, xr?: import("./headset.js").Xr}} */ (
      /** @type {unknown} */ (navigator));
    const headset = this.headset = new Headset(hand, page);
    if (xr) xr.isSessionSupported("immersive-vr").then((can) => can && offer("headset", () => headset.toggle(xr)), () => {});
    if (hid) {
      offer("spacemouse", () => this.spaceMouse.connect(hid));
      this.spaceMouse.resume(hid).catch((/** @type {Error} */ error) => say(error.message));
    }
    if (matchMedia("(hover: hover)").matches) offer("haply", () => this.haply.connect());
    this.haply.resume();
  }

  /** What they do meanwhile, the gamepad too. @param {number} passed since the last time [s] @param {number} now [ms] */
  tick(passed, now) {
    this.gamepad.tick(passed, now);
    this.spaceMouse.tick(passed, now);
    this.haply.tick(now);
    this.headset.controllers.tick(now);
  }
}
