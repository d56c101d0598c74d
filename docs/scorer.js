// Sphinx's own scores, but pages that explain come before pages that list.
window.Scorer = {
  score([page, , , , score]) {
    if (page.startsWith("guides/")) return score + 3;
    if (page.startsWith("explanation/") || !page.includes("/")) return score + 2;
    return page.startsWith("generated/") ? score - 4 : score;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
