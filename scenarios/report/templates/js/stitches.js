// The stitches of the chosen method: lines on the map, and a list to open them from.
const STATES = {
  accepted: { label: "accepted", line: { weight: 2.5, opacity: 0.9 }, key: "line", on: true },
  false: { label: "accepted, but false", line: { weight: 4, opacity: 0.95 }, key: "line", on: true },
  rejected: { label: "rejected by the graph", line: { weight: 2, opacity: 0.9, dashArray: "6 4" }, key: "dash", on: false },
  refused: { label: "refused by the stitching", line: { weight: 1.5, opacity: 0.8, dashArray: "2 4" }, key: "dash", on: false },
};

function stitchLayer(method, state, renderer, open) {
  const { line } = STATES[state];
  return together(method.stitches.flatMap((stitch, index) => {
    if (stitch.state !== state) return [];
    const ends = [stitch.merges ? stitch.b - 1 : stitch.a, stitch.b].map((k) => at(...method.submaps[k].pose));
    const middle = [0, 1].map((i) => (ends[0][i] + ends[1][i]) / 2);
    const parts = [
      styled(L.polyline(ends, { renderer, ...line }), `--${state}`),
      styled(L.circleMarker(middle, { renderer, radius: 3, weight: 1.5, fillOpacity: 0.9 }), `--${state}`, `--${state}`),
    ];
    parts.forEach((part) => part.bindTooltip(make("span", {}, `${stitchName(stitch)}: ${STATES[state].label}`), { sticky: true }).on("click", () => open(index)));
    return parts;
  }));
}

const stitchName = (stitch) => (stitch.merges ? `piece ${stitch.b} to all before it` : `submap ${stitch.b} to ${stitch.a}`);

// Every wall cell of a submap as a square, as large as it is.
function submapLayer(method, renderer) {
  return together(method.submaps.map((submap, index) => {
    const points = submap.points(), r = 0.05, cells = [];
    for (let i = 0; i < points.length; i += 2) {
      const [x, y] = [points[i], points[i + 1]];
      const corners = moved(submap.pose, [x - r, y - r, x + r, y - r, x + r, y + r, x - r, y + r]);
      cells.push([0, 2, 4, 6].map((k) => at(corners[k], corners[k + 1])));
    }
    const name = `--c${index % 8}`;
    return styled(L.polygon(cells, { renderer, weight: 1, fillOpacity: 1, interactive: false, smoothFactor: 0 }), name, name);
  }));
}

function cutLayer(run, method, renderer) {
  const style = { renderer, weight: 3, interactive: false };
  return together(method.cuts.map(([first, last]) => {
    const from = shownNear(run, first), to = shownNear(run, last);
    const [x, y] = poseAt(method.poses, (from + to) >> 1), r = 0.14;
    return styled(L.polyline([[at(x - r, y - r), at(x + r, y + r)], [at(x - r, y + r), at(x + r, y - r)]], style), "--cut");
  }));
}

// Where the map contradicts itself: a ring that says why.
function contradictionLayer(method, renderer) {
  return together(method.contradictions.map(({ place, scans, reason }) => {
    const ring = styled(L.circleMarker(at(...place), { renderer, radius: 11, weight: 3, fill: false }), "--false");
    return ring.bindTooltip(make("span", {}, `scans ${scans[0]} and ${scans[1]}: ${reason}`), { sticky: true });
  }));
}

function chosenLayers(run, renderers, chosen, open) {
  const has = (state) => run.methods.some((method) => method.stitches.some((stitch) => stitch.state === state));
  const layers = [];
  if (run.methods.some((method) => method.submaps.length)) {
    layers.push({ id: "submaps", label: "submaps", key: ["many"], on: false, build: () => submapLayer(chosen(), renderers.submaps) });
    layers.push({ id: "cuts", label: "cuts", key: ["cross", "--cut"], on: true, build: () => cutLayer(run, chosen(), renderers.paths) });
  }
  for (const [state, { label, key: kind, on }] of Object.entries(STATES)) {
    if (has(state)) layers.push({ id: `stitches-${state}`, label: `stitches ${label}`, key: [kind, `--${state}`], on, build: () => stitchLayer(chosen(), state, renderers.stitches, open) });
  }
  if (run.methods.some((method) => method.contradictions.length)) {
    layers.push({ id: "contradictions", label: "where the map contradicts itself", key: ["ring", "--false"], on: true, build: () => contradictionLayer(chosen(), renderers.stitches) });
  }
  return layers;
}

function fillStitchList(table, method, open) {
  const number = (value, digits) => (value === null || value === undefined ? "–" : value.toFixed(digits));
  const body = table.tBodies[0];
  body.replaceChildren(...method.stitches.map((stitch, index) => {
    const button = make("button", { type: "button", "aria-label": `Open the stitch of ${stitchName(stitch)}` }, stitch.merges ? `… → ${stitch.b}` : `${stitch.a} → ${stitch.b}`);
    button.addEventListener("click", () => open(index));
    const state = make("span", { class: "state", style: `color: var(--${stitch.state === "accepted" || stitch.state === "false" ? stitch.state : "soft"})` }, STATES[stitch.state].label);
    return make("tr", {}, make("td", {}, button), make("td", {}, state),
      ...[number(stitch.belief, 1), number(stitch.score, 1), number(stitch.agreement, 2), number(stitch.overlap, 1), number(stitch.weight, 2), stitch.error ? number(stitch.error[0], 3) : "–"]
        .map((text) => make("td", { class: "number" }, text)),
      make("td", {}, stitch.reason || ""));
  }));
}
