// One stitch opened: the two maps before and after, the spectra behind it, the score around it, the reasons.
const MAP_A = "--c0", MAP_B = "--c1", BOTH = "--ink";
const CELL = 0.1;

function makeStitchView(section) {
  const part = (name) => section.querySelector(`[data-part="${name}"]`);
  let current = null;
  part("close").addEventListener("click", () => { section.hidden = true; current = null; });
  const draw = () => {
    const { method, stitch } = current;
    part("title").textContent = `${method.name}: ${stitchName(stitch)}`;
    fillFacts(part("facts"), factsOf(method, stitch));
    const maps = stitchMaps(method, stitch), panels = [];
    panel(panels, "before: as the front end had them", (place) => drawPieces(place, maps.a, moved(stitch.before, maps.b), false));
    if (stitch.T) panel(panels, stitch.state === "refused" ? "the best candidate, refused" : "after: as stitched", (place) => drawPieces(place, maps.a, moved(stitch.T, maps.b), true));
    const surface = stitch.evidence && stitch.evidence.surface;
    if (surface) panel(panels, "score of shifts around it", (place) => drawSurface(place, surface, stitch.T));
    if (stitch.evidence) addEvidence(panels, stitch);
    part("panels").replaceChildren(...panels.map((one) => one.place)); // all of them, or widths would be wrong
    panels.forEach((one) => one.draw(one.place));
  };
  onTheme(() => current && draw());
  return (method, stitch) => {
    current = { method, stitch };
    section.hidden = false;
    draw();
    part("title").focus();
    section.scrollIntoView({ block: "nearest" });
  };
}

function factsOf(method, stitch) {
  const pose = ([x, y, yaw]) => `${x.toFixed(2)} m, ${y.toFixed(2)} m, ${degrees(yaw).toFixed(1)}°`;
  const sigmas = ([x, y, yaw]) => `${metres(x)}, ${metres(y)}, ${degrees(yaw).toFixed(2)}°`;
  const span = (k) => `${k}: scans ${method.submaps[k].start} to ${method.submaps[k].stop - 1}`;
  return [
    ["verdict", STATES[stitch.state].label],
    ["reason", stitch.reason],
    ["pieces", `${stitch.merges ? "all before" : span(stitch.a)}; ${span(stitch.b)}`],
    ["b in a", stitch.T && pose(stitch.T)],
    ["expected", stitch.prior && `${pose(stitch.prior)}, ± ${sigmas(stitch.prior.slice(3))}`],
    ["1 σ", stitch.sigma && sigmas(stitch.sigma)],
    ["true error", stitch.error && `${stitch.error[0].toFixed(3)} m, ${stitch.error[1].toFixed(2)}°`],
    ["belief", stitch.belief === null || stitch.belief === undefined ? null : `${stitch.belief.toFixed(1)}: right with ${percent(1 / (1 + Math.exp(-stitch.belief)))}`],
    ["score", stitch.score === undefined ? null : stitch.score.toFixed(2)],
    ["next best", stitch.rivals && stitch.rivals.length ? stitch.rivals.slice(0, 2).map((rival) => `${rival[3].toFixed(2)} at ${pose(rival)}`).join("; ") : null],
    ["walls shared", stitch.agreement === undefined ? null : `${(100 * stitch.agreement).toFixed(0)} % of those in ${stitch.overlap.toFixed(1)} m² seen by both`],
    ["graph weight", stitch.weight === null || stitch.weight === undefined ? null : stitch.weight.toFixed(2)],
  ];
}

const percent = (share) => (share > 0.9995 ? "more than 99.9 %" : `${(100 * share).toFixed(1)} %`);

function panel(panels, title, draw) {
  panels.push({ place: make("div", {}, make("h4", {}, title)), draw });
}

// Points of both pieces in the frame of a; a piece that was stitched to all before it is shown with those.
function stitchMaps(method, stitch) {
  const b = method.submaps[stitch.b].points();
  if (!stitch.merges) return { a: method.submaps[stitch.a].points(), b };
  const parts = [method.submaps[0].points()];
  for (const other of method.stitches) {
    if (other.b < stitch.b) parts.push(moved(other.state === "refused" ? other.before : other.T, method.submaps[other.b].points()));
  }
  const a = new Float32Array(parts.reduce((sum, part) => sum + part.length, 0));
  parts.reduce((offset, part) => { a.set(part, offset); return offset + part.length; }, 0);
  return { a, b };
}

function drawPieces(place, a, b, agreement) {
  const canvas = make("canvas", { class: "drawn", width: 640, height: 460, role: "img", "aria-label": "Walls of both pieces, a in blue, b in orange, those of both in the text colour" });
  place.append(canvas);
  const scale = fitted(canvas, a, b), context = canvas.getContext("2d");
  const size = Math.max(2.5, CELL * scale.factor);
  const dot = (points, i, name) => {
    context.fillStyle = name;
    context.fillRect(scale.x(points[i]) - size / 2, scale.y(points[i + 1]) - size / 2, size, size);
  };
  const inBoth = agreement ? cellsNear(a) : null;
  const [blue, orange, ink] = [MAP_A, MAP_B, BOTH].map(colour);
  for (let i = 0; i < a.length; i += 2) dot(a, i, blue);
  for (let i = 0; i < b.length; i += 2) dot(b, i, inBoth && inBoth(b[i], b[i + 1]) ? ink : orange);
  const named = agreement ? [["a", MAP_A], ["b", MAP_B], ["both", BOTH]] : [["a", MAP_A], ["b", MAP_B]];
  place.append(make("p", { class: "soft" }, ...named.flatMap(([name, key]) => [make("span", { class: "swatch", style: `--colour: var(${key})` }), `${name}  `]), `· ${(canvas.width / scale.factor).toFixed(0)} m across`));
}

function fitted(canvas, ...clouds) {
  let [x0, x1, y0, y1] = [Infinity, -Infinity, Infinity, -Infinity];
  for (const points of clouds) for (let i = 0; i < points.length; i += 2) {
    x0 = Math.min(x0, points[i]); x1 = Math.max(x1, points[i]);
    y0 = Math.min(y0, points[i + 1]); y1 = Math.max(y1, points[i + 1]);
  }
  if (!Number.isFinite(x0)) [x0, x1, y0, y1] = [-1, 1, -1, 1];
  const factor = Math.min((canvas.width - 30) / Math.max(x1 - x0, 1), (canvas.height - 30) / Math.max(y1 - y0, 1));
  return { factor, x: (x) => canvas.width / 2 + factor * (x - (x0 + x1) / 2), y: (y) => canvas.height / 2 - factor * (y - (y0 + y1) / 2) };
}

function cellsNear(points) {
  const key = (x, y) => `${x},${y}`, cell = (value) => Math.floor(value / CELL), cells = new Set();
  for (let i = 0; i < points.length; i += 2) {
    for (let dx = -1; dx <= 1; dx++) for (let dy = -1; dy <= 1; dy++) cells.add(key(cell(points[i]) + dx, cell(points[i + 1]) + dy));
  }
  return (x, y) => cells.has(key(cell(x), cell(y)));
}

function addEvidence(panels, stitch) {
  const { spectra, correlation, axes } = stitch.evidence;
  const whole = Array.from({ length: 180 }, (_, i) => i);
  const turn = ((Math.round(degrees(stitch.T[2])) % 180) + 180) % 180;
  panel(panels, "Hough spectra [°]", (place) => chart(place, "", whole, [
    { label: "a", colour: MAP_A, values: numbers(spectra[0]) }, { label: "b", colour: MAP_B, values: numbers(spectra[1]) }], { height: 170 }));
  panel(panels, `their correlation [°]: turned by ${degrees(stitch.T[2]).toFixed(1)}°`, (place) =>
    marker(chart(place, "", whole, [{ label: "correlation", colour: BOTH, values: numbers(correlation) }], { height: 170 }), turn));
  axes.forEach((axis, i) => {
    const name = "XY"[i];
    panel(panels, `${name} spectra [m], b where it was put`, (place) => drawProfiles(place, axis));
    panel(panels, `their correlation [m]: shifted by ${axis.shift.toFixed(2)} m`, (place) => {
      const values = numbers(axis.correlation[1]);
      marker(chart(place, "", spaced(axis.correlation[0], values.length), [{ label: "correlation", colour: BOTH, values }], { height: 170 }), axis.shift);
    });
  });
}

const spaced = (first, count) => Array.from({ length: count }, (_, i) => first + CELL * i);

function drawProfiles(place, axis) {
  const a = numbers(axis.a[1]), b = numbers(axis.b[1]);
  const first = Math.round(Math.min(axis.a[0], axis.b[0] + axis.shift) / CELL), last = Math.round(Math.max(axis.a[0] + CELL * a.length, axis.b[0] + axis.shift + CELL * b.length) / CELL);
  const over = (values, start) => { const skip = Math.round(start / CELL) - first; return Array.from({ length: last - first }, (_, i) => values[i - skip] ?? 0); };
  chart(place, "", spaced(first * CELL, last - first), [
    { label: "a", colour: MAP_A, values: over(a, axis.a[0]) }, { label: "b", colour: MAP_B, values: over(b, axis.b[0] + axis.shift) }], { height: 170 });
}

// Shifts as a field of shades: bright is good, the cross is the answer.
function drawSurface(place, surface, T) {
  const values = numbers(surface.values), width = surface.width, height = values.length / width;
  const canvas = make("canvas", { class: "drawn square", width: 640, height: Math.round(640 * height / width), role: "img", "aria-label": "Score of shifts around the answer, bright is good, the cross is the answer" });
  const context = canvas.getContext("2d"), cell = 640 / width;
  for (let i = 0; i < values.length; i++) {
    context.fillStyle = viridis(values[i]);
    context.fillRect(i % width * cell, canvas.height - (Math.floor(i / width) + 1) * cell, cell + 1, cell + 1);
  }
  const x = ((T[0] - surface.first[0]) / surface.step + 0.5) * cell, y = canvas.height - ((T[1] - surface.first[1]) / surface.step + 0.5) * cell;
  context.strokeStyle = "#ffffff";
  context.lineWidth = 3;
  context.beginPath();
  context.moveTo(x - 16, y); context.lineTo(x + 16, y); context.moveTo(x, y - 16); context.lineTo(x, y + 16);
  context.stroke();
  place.append(canvas, make("p", { class: "soft" }, `${(width * surface.step).toFixed(1)} × ${(height * surface.step).toFixed(1)} m; bright: walls on walls, dark: walls in free space`));
}

const VIRIDIS = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];

function viridis(value) {
  const place = Math.min(Math.max(value, 0), 1) * 4, i = Math.min(Math.floor(place), 3), share = place - i;
  return `rgb(${VIRIDIS[i].map((low, c) => Math.round(low + share * (VIRIDIS[i + 1][c] - low))).join(" ")})`;
}
