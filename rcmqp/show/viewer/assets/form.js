// Questions of a trial, before or after the task; the answers go by the page's socket.

import { query } from "./elements.js";
import { Link } from "./link.js";

const form = /** @type {HTMLFormElement} */ (query(document, "#form"));
const page = { steers: false };

/** @param {string} why */
function say(why) { query(document, "#problem").textContent = why; }

const link = new Link({
  state() {}, // of a loop that has ended
  free() {
    if (!link.takeAgain()) say("no page has the questions; load this one again to answer here");
  },
  role(steers) {
    page.steers = steers;
    say(steers ? "" : "another page has the questions");
  },
  next() { link.reload(page.steers); },
  refused: say,
  ended() { say("the connection is lost; please ask the experimenter"); },
});

/** Every answer by its question: a number, whether a box is ticked, or a text. */
function answers() {
  /** @type {Record<string, number | boolean | string>} */
  const values = {};
  for (const field of form.elements)
    if (field instanceof HTMLTextAreaElement) values[field.name] = field.value;
    else if (field instanceof HTMLInputElement && field.type === "checkbox") values[field.name] = field.checked;
    else if (field instanceof HTMLInputElement && field.checked) values[field.name] = Number(field.value);
  return values;
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  if (page.steers) link.send({ kind: "answers", values: answers() });
});
document.querySelector("#break")?.addEventListener("click", () => {
  if (window.confirm("Break off here? You can go on later.")) link.send({ kind: "break" });
});
document.documentElement.dataset.ready = "";
