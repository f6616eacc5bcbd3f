// Charts over the drive: what every method was off, and the confidence of the chosen method's matches.
function makeMeasures(run, place, chips, goTo) {
  const x = Array.from(run.rows);
  const shown = new Map();
  let markers = [], method = null, scan = 0;

  const charts = () => {
    const found = [];
    if (run.truth) found.push({ id: "off", title: "position error [m]", log: true, on: true, series: run.methods.map((one) => ({ label: one.name, colour: one.colour, values: one.off() })) });
    const track = method.track;
    if (!track) return found;
    const lost = failures(track);
    for (const [name, values] of Object.entries(track.measures)) {
      if (name === "neg_matches") continue; // the chart of matches has it
      const unit = UNITS[name] ? ` [${UNITS[name]}]` : "";
      found.push({ id: name, title: `${name}${unit}, larger = less sure`, log: true, on: name === "trace2", series: [{ label: name, colour: method.colour, values }], lost });
    }
    found.push({ id: "matches", title: "matched points", on: true, series: [{ label: "matches", colour: method.colour, values: tried(track, track.matches) }], lost });
    if (track.error) found.push({ id: "error", title: "true error of the step [m]", log: true, on: true, series: [{ label: "error", colour: method.colour, values: track.error }] });
    return found;
  };

  const draw = () => {
    place.replaceChildren();
    markers = charts().filter((one) => shown.get(one.id)).map((one) => {
      const holder = place.appendChild(make("div"));
      const plot = chart(holder, one.title, x, withLost(one), { log: one.log, bands: method.cuts, cursor: { sync: { key: "drive" } } });
      plot.over.addEventListener("click", () => plot.cursor.idx !== null && goTo(plot.cursor.idx));
      return marker(plot);
    });
    markers.forEach((move) => move(x[scan]));
  };

  const choose = (next) => {
    method = next;
    const found = charts();
    found.forEach((one) => shown.has(one.id) || shown.set(one.id, one.on));
    chips.replaceChildren(...found.map((one) => {
      const button = make("button", { type: "button", "aria-pressed": String(shown.get(one.id)) }, one.id === "off" ? "position error" : one.id === "error" ? "step error" : one.id);
      button.addEventListener("click", () => {
        shown.set(one.id, !shown.get(one.id));
        button.setAttribute("aria-pressed", String(shown.get(one.id)));
        draw();
      });
      return button;
    }));
    draw();
  };
  onTheme(() => method && draw());
  new ResizeObserver(redrawOnWidth(place, draw)).observe(place);
  return { choose, at: (k) => { scan = k; markers.forEach((move) => move(x[k])); } };
}

function redrawOnWidth(place, draw) {
  let width = place.clientWidth;
  return () => { if (Math.abs(place.clientWidth - width) > 8) { width = place.clientWidth; draw(); } };
}

const SKIPPED = 2;
const tried = (track, values) => values.map((value, k) => (track.verdict[k] === SKIPPED ? NaN : value));
const failures = (track) => Array.from(track.matches, (count, k) => track.verdict[k] !== SKIPPED && count === 0 && k > 0);

// Steps without a single match as red dots at the foot of the chart.
function withLost(one) {
  if (!one.lost || !one.lost.some(Boolean)) return one.series;
  const positive = Array.from(one.series[0].values).filter((value) => Number.isFinite(value) && value > 0);
  const foot = one.log ? positive.reduce((low, value) => Math.min(low, value), Infinity) : 0;
  const values = one.lost.map((lost) => (lost && Number.isFinite(foot) ? foot : NaN));
  return [...one.series, { label: "no match", colour: "--false", values, points: true }];
}
