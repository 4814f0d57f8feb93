// First answer of the site's search to each query: node search.js SITE QUERY ... runs Sphinx's own scripts without a page.
const fs = require("fs");
const [site, ...queries] = process.argv.slice(2);
const files = ["_static/language_data.js", "_static/searchtools.js", "searchindex.js"];
const scripts = files.map((file) => fs.readFileSync(`${site}/${file}`, "utf8"));
const page = `
  var window = globalThis, location = {}, document = {documentElement: {dataset: {}}, getElementById() {}};
  var localStorage = {setItem() {}}, DOCUMENTATION_OPTIONS = {}, SPHINX_HIGHLIGHT_ENABLED = false;
  var _ready = () => {}, _ = (text) => text;
`;
const ask = `
  (query) => {
    location.search = "?q=" + query;
    const [name, , anchor] = Search._performSearch(...Search._parseQuery(query)).pop();
    return name + anchor;
  };
`;
const answer = (0, eval)([page, ...scripts, ask].join(";\n"));
queries.forEach((query) => console.log(answer(query)));
