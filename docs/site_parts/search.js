// Order of the search's answers: pages whose title has all words of the query, then headings, then texts.
// A page with such a heading opens there. Sphinx puts this file into language_data.js (html_search_scorer).
var Scorer = {
  stems: (text) => {
    const stemmer = new Stemmer();
    const words = text.toLowerCase().split(/[^\p{L}\p{N}_]+/u);
    return words.filter((word) => word && !stopwords.has(word)).map((word) => stemmer.stemWord(word));
  },
  score: (result) => {
    const query = Scorer.stems(new URLSearchParams(window.location.search).get("q") ?? "");
    const page = Search._index.docnames.indexOf(result[0]);
    let best = 0;
    for (const [title, places] of Object.entries(Search._index.alltitles)) {
      const words = Scorer.stems(title);
      const place = places.find(([file]) => file === page);
      if (!place || !query.length || result[6] === "object" || !query.every((word) => words.includes(word))) continue;
      const whole = Search._index.titles[page] === title;
      const score = (whole ? 60 : 40) + (10 * query.length) / words.length;
      if (score <= best) continue;
      best = score;
      result[1] = whole ? title : `${Search._index.titles[page]} > ${title}`;
      result[2] = whole || place[1] === null ? "" : `#${place[1]}`;
    }
    return best || result[4];
  },
  objNameMatch: 11, objPartialMatch: 6, objPrio: { 0: 15, 1: 5, 2: -5 }, objPrioDefault: 0,
  title: 15, partialTitle: 7, term: 5, partialTerm: 2,
};
