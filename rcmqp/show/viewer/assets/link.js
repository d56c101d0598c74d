// The page's socket to the server: hands go, states come, and both clocks are compared.

/** Ages that are kept until they are told, at most. */
const UNTOLD = 75;
/** Answers to pings that the clocks are compared by. */
const PINGS = 10;
/** How much later a page that watches goes on than the operator's, who steers on [ms]. */
const WATCHER = 1500;
/** How long a tab that has only watched leaves a trial to the participant's, whose page may be slow to load [ms]. */
const LEFT_TO_OTHERS = 30000;
/** What a tab keeps over its pages: whether it has steered, or only watched. */
const ROLE = "role";

/**
 * @typedef {import("./sources.js").State & {
 *   time: number, at: number, moving: boolean, stopped: number, skipped: number, viscosity: number, reached: number[], latency?: Record<string, number[]>
 * }} Live
 */

export class Link {
  /**
   * @param {{state: (state: Live) => void, role: (steers: boolean) => void, free: () => void, ended: (why: string) => void,
   *   next?: () => void, refused?: (why: string) => void}} listener the last two in a trial
   */
  constructor(listener) {
    this.number = 0;
    this.over = false;
    /** Ages of states when they were drawn [ms], not told yet. @type {number[]} */
    this.drawn = [];
    /** Of pings: how long there and back, and how far the server's clock is ahead [ms]. @type {[number, number][]} */
    this.pings = [];
    this.socket = new WebSocket(`ws://${location.host}/hand${location.search}`);
    this.socket.addEventListener("open", () => {
      this.ping();
      if (!listener.next || sessionStorage.getItem(ROLE) !== "watched") return this.take();
      listener.role(false);
      setTimeout(() => this.take(), LEFT_TO_OTHERS);
    });
    this.socket.addEventListener("close", () => {
      if (this.over) return;
      const line = document.querySelector("#over p");
      if (line) line.textContent = "The connection is lost. Please tell the experimenter.";
      listener.ended("the connection is lost; the arm is at rest");
    });
    this.socket.addEventListener("message", ({ data }) => {
      const said = JSON.parse(data);
      if (said.kind === "state") listener.state(said);
      else if (said.kind === "pong") this.compare(said);
      else if (said.kind === "role") {
        if (said.steers) sessionStorage.setItem(ROLE, "steered");
        else if (!this.steered) sessionStorage.setItem(ROLE, "watched");
        listener.role(said.steers);
      }
      else if (said.kind === "free") listener.free();
      else if (said.kind === "over") this.cover(said);
      else if (said.kind === "next") listener.next?.();
      else if (said.kind === "refused") listener.refused?.(said.why);
      else if (said.kind === "ended") listener.ended(said.why);
    });
    setInterval(() => this.ping(), 1000);
  }

  /** What the page was for is over: say so in its place. @param {{title: string, text: string, last: boolean}} words */
  cover({ title, text, last }) {
    this.over = last; // the server goes then, and nothing is lost
    document.querySelector("#over")?.remove();
    const [cover, heading, line] = [document.createElement("main"), document.createElement("h1"), document.createElement("p")];
    cover.className = "form";
    cover.id = "over";
    [heading.textContent, line.textContent] = [title, text];
    cover.append(heading, line);
    document.body.append(cover);
  }

  get open() { return this.socket.readyState === WebSocket.OPEN; }

  /** How far the server's clock is ahead of the page's [ms]; null before it is known. */
  get ahead() {
    if (!this.pings.length) return null;
    return this.pings.reduce((a, b) => (b[0] < a[0] ? b : a))[1];
  }

  /** The server's time [s] of the page's [ms]. @param {number} at */
  seconds(at) { return (at + (this.ahead ?? 0)) / 1000; }

  /** @param {object} words */
  send(words) {
    if (this.open) this.socket.send(JSON.stringify(words));
  }

  ping() { this.send({ kind: "ping", at: performance.now(), drawn: this.drawn.splice(0) }); }

  take() { this.send({ kind: "take" }); }

  get steered() { return sessionStorage.getItem(ROLE) === "steered"; }

  /** Steer on after a page of this tab that steered; whether there was one. */
  takeAgain() {
    if (this.steered) this.take();
    return this.steered;
  }

  /** Go on with the next page. @param {boolean} steers whether this page does */
  reload(steers) { setTimeout(() => location.reload(), steers ? 0 : WATCHER); }

  /** @param {{at: number, now: number}} pong */
  compare({ at, now }) {
    const came = performance.now();
    this.pings = [...this.pings.slice(1 - PINGS), [came - at, 1000 * now - (at + came) / 2]];
  }

  /** @param {import("./hands.js").Hand} hand */
  tell(hand) {
    if (this.ahead === null) return;
    this.number += 1;
    const event = hand.event === null ? null : this.seconds(hand.event);
    hand.event = null;
    this.send({
      kind: "hand", number: this.number, grip: hand.grip, held: hand.held,
      at: this.seconds(performance.now()), event, way: hand.way, felt: hand.felt, devices: hand.devices,
    });
  }

  /** A state has been drawn. @param {Live} state @returns {number} its age [ms] */
  saw({ at }) {
    const age = 1000 * (this.seconds(performance.now()) - at);
    if (this.ahead !== null && this.drawn.length < UNTOLD) this.drawn.push(age);
    return age;
  }
}
