// Draws the figures of a report page, in the colors of the reader's scheme, and in light ones of a sheet's width for print.
(function () {
  'use strict';
  const inDark = JSON.parse(document.getElementById('dark-colors').textContent);
  const scheme = window.matchMedia('(prefers-color-scheme: dark)');
  const narrow = window.innerWidth < 640, sheet = 680, page = 900;
  const options = {responsive: true, displaylogo: false, displayModeBar: narrow ? false : 'hover',
    modeBarButtonsToRemove: ['select2d', 'lasso2d']};
  const drawn = new Set();
  let printing = false;

  function figure(element) {
    let text = document.getElementById(element.dataset.figure).textContent;
    if (scheme.matches && !printing) {
      for (const [light, dark] of Object.entries(inDark)) text = text.replaceAll(light, dark);
    }
    const found = JSON.parse(text), layout = found.layout;
    if (narrow) roomForLegend(found.data, layout);
    if (printing) Object.assign(layout, {width: sheet, height: Math.min(layout.height, page), autosize: false});
    element.style.height = layout.height + 'px';
    return found;
  }
  // Two names a row, and rows above the figure instead of over it.
  function roomForLegend(data, layout) {
    const names = data.filter((trace) => trace.name && trace.showlegend !== false).length;
    const rows = names > 1 || layout.showlegend ? Math.ceil(names / 2) : 0, more = 20 * Math.max(0, rows - 1);
    layout.legend = {...layout.legend, entrywidth: 118, entrywidthmode: 'pixels', font: {size: 12}};
    layout.margin.t += more;
    layout.height += more;
  }
  function draw(element) {
    const {data, layout} = figure(element);
    drawn.add(element);
    return Plotly.react(element, data, layout, options);
  }
  // Figures in closed parts have no width yet: they are drawn when somebody opens them.
  const waiting = [];
  for (const element of document.querySelectorAll('.plot')) {
    const closed = element.closest('details:not([open])');
    if (closed) closed.addEventListener('toggle', () => draw(element), {once: true}); else waiting.push(element);
  }
  function drawNext() {
    const element = waiting.shift();
    if (element) draw(element).finally(() => setTimeout(drawNext, 0));
  }
  drawNext();
  const redraw = () => drawn.forEach(draw);
  scheme.addEventListener('change', redraw);
  window.addEventListener('beforeprint', () => { printing = true; redraw(); });
  window.addEventListener('afterprint', () => { printing = false; redraw(); });
})();
