// Order of the search's answers: pages whose title has all words of the query, then headings, then texts.
// A page with such a heading opens there; records, studies and the API come after what a user reads, and
// of texts the glossary first.
// Sphinx puts this file into language_data.js (html_search_scorer).
var Scorer = {
  records: /^(studies|reference\/api|changelog|papers|validation_checks)/,
  stems: (text) => {
    const stemmer = new Stemmer();
    const words = text.toLowerCase().split(/[^\p{L}\p{N}_]+/u);
    return words.filter((word) => word && !stopwords.has(word)).map((word) => stemmer.stemWord(word));
  },
  score: (result) => {
    if (result[6] === "object") return result[4];
    const query = Scorer.stems(new URLSearchParams(window.location.search).get("q") ?? "");
    const page = Search._index.docnames.indexOf(result[0]);
    let best = 0, part = 0;
    for (const [title, places] of Object.entries(Search._index.alltitles)) {
      const words = Scorer.stems(title);
      const place = places.find(([file]) => file === page);
      const common = query.filter((word) => words.includes(word)).length;
      if (!place || !common) continue;
      part = Math.max(part, common / words.length);
      if (common < query.length) continue;
      const whole = Search._index.titles[page] === title;
      const score = (whole ? 60 : 40) + (10 * common) / words.length;
      if (score <= best) continue;
      best = score;
      result[1] = whole ? title : `${Search._index.titles[page]} > ${title}`;
      result[2] = whole || place[1] === null ? "" : `#${place[1]}`;
    }
    const text = Math.min(result[4], 5) + 5 * part + (result[0] === "glossary" ? 3 : 0);
    return (best || text) - (Scorer.records.test(result[0]) ? (best ? 36 : 5) : 0);
  },
  objNameMatch: 35, objPartialMatch: 1, objPrio: { 0: 0, 1: 0, 2: -1 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
