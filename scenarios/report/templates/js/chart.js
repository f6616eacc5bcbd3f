// Lines over one axis, drawn by uPlot in the colours of the theme.
const UNITS = { trace2: "m²", det2: "m⁴" };
const gapless = (values) => Array.from(values, (value) => (Number.isFinite(value) ? value : null));

function chart(place, title, x, series, options = {}) {
  const axis = { stroke: colour("--soft"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line") }, font: "11px sans-serif" };
  const positive = (values) => values.some((value) => value > 0);
  const log = options.log && series.some((one) => positive(one.values));
  const clean = (values) => gapless(values).map((value) => (log && value !== null && value <= 0 ? null : value));
  const plot = new uPlot({
    title, width: Math.max(place.clientWidth, 120), height: options.height || 120,
    legend: { show: series.length > 1, live: false }, cursor: { y: false, points: { size: 6 }, drag: { x: true, y: false }, ...options.cursor },
    scales: { x: { time: false }, y: log ? { distr: 3, log: 10, range: decades } : { range: (_, low, high) => [Math.min(low ?? 0, 0), high > 0 ? 1.08 * high : 1] } },
    axes: [
      { ...axis, size: 26, gap: 3, space: 50 },
      { ...axis, size: 52, gap: 3, space: log ? 16 : 26, ...(log ? onlyDecades(axis) : {}), values: (_, splits) => splits.map((value) => (value === null ? "" : brief(value))) },
    ],
    series: [{ label: options.xLabel || "" }, ...series.map((one) => ({
      label: one.label, stroke: colour(one.colour), width: one.width || 1.3, points: { show: Boolean(one.points), size: 6, fill: colour(one.colour) },
      paths: one.points ? () => null : undefined, spanGaps: false,
    }))],
    hooks: { drawClear: (options.bands || []).length ? [(u) => shade(u, options.bands)] : [] },
  }, [x, ...series.map((one) => clean(one.values))], place);
  plot.root.setAttribute("role", "img");
  plot.root.setAttribute("aria-label", title);
  return plot;
}

// Whole decades around the values, five at most: what is smaller still is as good as nothing.
function decades(_, low, high) {
  const top = Math.ceil(Math.log10(high ?? 1)), foot = Math.floor(Math.log10(low ?? 0.1));
  return [10 ** Math.max(foot, top - 5), 10 ** Math.max(top, foot + 1)];
}

function onlyDecades(axis) {
  const filter = (_, splits) => splits.map((value) => (Math.abs(Math.log10(value) % 1) < 1e-6 ? value : null));
  return { filter, grid: { ...axis.grid, filter }, ticks: { ...axis.ticks, filter } };
}

function brief(value) {
  const size = Math.abs(value);
  if (size !== 0 && (size < 0.001 || size >= 10000)) return value.toExponential(0).replace("e+", "e");
  return String(Number(value.toPrecision(3)));
}

function shade(u, bands) {
  u.ctx.save();
  u.ctx.fillStyle = colour("--cut");
  u.ctx.globalAlpha = 0.25;
  for (const [first, last] of bands) {
    const left = u.valToPos(first - 0.5, "x", true), right = u.valToPos(last + 0.5, "x", true);
    u.ctx.fillRect(left, u.bbox.top, Math.max(right - left, 2), u.bbox.height);
  }
  u.ctx.restore();
}

// A line that marks one place of the x axis, moved without drawing the chart anew.
function marker(plot, x = null) {
  const line = plot.over.appendChild(make("div", { class: "now" }));
  let here = x;
  const put = () => { if (here !== null) line.style.left = `${plot.valToPos(here, "x")}px`; };
  plot.hooks.draw = [...(plot.hooks.draw || []), put];
  return (next) => { here = next; put(); };
}
