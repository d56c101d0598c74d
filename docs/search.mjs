// Newcomers' questions, typed into the search of the built site: node docs/search.mjs docs/_build/html
// Each must find its page first. This runs the site's own search scripts, without a browser.

import { readFileSync } from "node:fs";
import { join } from "node:path";
import process from "node:process";
import vm from "node:vm";

const QUESTIONS = {
  "use my own robot": "guides/my_robot",
  "moving trocar": "guides/moving_trocars",
  "camera rolls": "guides/my_task",
  "jerk limit": "explanation/braking",
  "install without compiler": "troubleshooting",
  "real robot": "guides/real_arm",
  "how to cite": "faq",
  "export figure pdf": "guides/figures",
  units: "explanation/conventions",
  "add a task": "guides/my_task",
  cluster: "guides/cluster",
  "wrist instrument": "guides/my_port_and_tool",
};

const site = process.argv[2];
const nothing = () => {};
const page = vm.createContext({
  DOCUMENTATION_OPTIONS: {},
  SPHINX_HIGHLIGHT_ENABLED: false,
  _: String,
  document: { getElementById: nothing },
  location: { search: "" },
  _ready: nothing,
});
page.window = page;
const scripts = ["_static/language_data.js", "_static/searchtools.js", "searchindex.js"];
for (const script of scripts) {
  vm.runInContext(readFileSync(join(site, script), "utf8"), page, { filename: script });
}

let wrong = 0;
for (const [question, wanted] of Object.entries(QUESTIONS)) {
  page.question = question;
  const found = vm.runInContext("Search._performSearch(...Search._parseQuery(question))", page);
  const docs = [...new Set(found.reverse().map(([doc]) => doc))];
  if (docs[0] !== wanted) {
    wrong += 1;
    console.error(`${question}: ${wanted} is no. ${docs.indexOf(wanted) + 1}, after ${docs.slice(0, 3).join(", ")}`);
  }
}
console.log(`${Object.keys(QUESTIONS).length} questions, ${wrong} of them find another page first`);
process.exitCode = wrong ? 1 : 0;
