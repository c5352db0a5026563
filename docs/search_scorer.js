// Weights of the search: what to do comes before how it was measured, and a page that is named first of all. Sphinx
// reads this file.
var PAGE_WEIGHTS = { first_steps: 2, recipes: 1.5, node: 1.5, localizer: 1.5, benchmarks: 0.2, experiments: 0.1, papers: 0.5 };
var ASKED = (new URLSearchParams(location.search).get("q") ?? "").toLowerCase().split(/\W+/);

// Share of the words of a page's file name that are asked for.
function namedShare(page) {
  const words = page.split("_").filter((word) => word !== "a");
  return words.filter((word) => ASKED.includes(word)).length / words.length;
}

var Scorer = {
  // A result is [page, title, anchor, description, score, file, kind].
  score: ([page, , , , score]) => score * (PAGE_WEIGHTS[page] ?? 1) * (1 + 2 * namedShare(page)),
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
