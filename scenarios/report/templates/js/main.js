// Puts the page together.
const VERDICTS = ["matched", "fell back on dead reckoning", "not matched: it had hardly moved"];

const part = (id) => document.getElementById(id);

function start() {
  themeSwitch(part("theme"));
  part("copy")?.addEventListener("click", () => navigator.clipboard?.writeText(part("command").textContent));
  if (part("run-data")) live(readRun());
  document.documentElement.dataset.ready = "true";
}

function live(run) {
  const state = { scan: 0, method: run.methods.find((method) => method.name === run.best) || run.methods[0] };
  const { map, renderers } = makeMap(part("map"));
  const bounds = boundsOf(run);
  map.fitBounds(bounds, { animate: false });
  part("whole").addEventListener("click", () => map.fitBounds(bounds));
  const open = stitchOpener(state);
  const robot = makeRobot(run, renderers.robot);
  robot.body.addTo(map);
  const refresh = fillLayers(run, map, renderers, robot, state, open);
  const drawTilt = makeTilt(part("tilt"), run);
  const measures = makeMeasures(run, part("charts"), part("chips"), (k) => setScan(k));
  const setScan = makeTime(run, part("scan"), part("scan-text"), part("play"), (k) => {
    state.scan = k;
    const seen = robot.move(state.method, k);
    drawTilt(k);
    measures.at(k);
    fillFacts(part("robot-facts"), robotFacts(run, state.method, k, seen));
  });
  const choose = (method) => {
    state.method = method;
    showPath(run.methods.indexOf(method));
    refresh();
    robot.paint(method);
    measures.choose(method);
    showStitches(method, open);
    setScan(state.scan);
  };
  onTheme(() => robot.paint(state.method));
  state.scan = strangest(run, state.method);
  fillPicker(run, state.method, choose);
  choose(state.method);
}

// Opens a stitch of the chosen method, and marks it in the list.
function stitchOpener(state) {
  const view = makeStitchView(part("stitch"));
  return (index) => {
    view(state.method, state.method.stitches[index]);
    [...part("stitch-list").tBodies[0].rows].forEach((row, i) => row.setAttribute("aria-current", String(i === index)));
  };
}

// Check boxes for everything; what belongs to the chosen method is built anew by the function returned.
function fillLayers(run, map, renderers, robot, state, open) {
  const world = worldLayers(run, renderers), methods = methodLayers(run, renderers);
  const own = chosenLayers(run, renderers, () => state.method, open);
  const sensed = [
    { id: "scan", label: "scan: beams that fit / do not", key: ["dots", "--fits", "--misfits"], on: true, build: () => robot.scan },
    { id: "ellipse", label: "95 % ellipse, dashed ten times as large", key: ["ring", "--ink"], on: true, build: () => robot.ellipse },
  ];
  const switches = makeSwitches(map, [...world, ...methods, ...own, ...sensed]);
  if (world.length) part("layers").append(simpleGroup("World", world, switches));
  part("layers").append(methodGroup(run, methods, switches));
  part("own-layers").append(simpleGroup("", [...own, ...sensed], switches));
  return () => switches.rebuild(own.map((layer) => layer.id));
}

function fillPicker(run, method, choose) {
  const picker = part("method");
  picker.append(...run.methods.map((one, i) => make("option", { value: i }, one.name)));
  picker.value = String(run.methods.indexOf(method));
  picker.addEventListener("change", () => choose(run.methods[Number(picker.value)]));
}

function showStitches(method, open) {
  fillStitchList(part("stitch-list"), method, open);
  part("no-stitches").hidden = method.stitches.length > 0;
  part("stitch-list").parentElement.hidden = method.stitches.length === 0;
  part("stitch").hidden = true;
  part("stitches-of").textContent = method.name;
}

// What is looked at closely has its path on the map.
function showPath(index) {
  const box = document.querySelector(`[data-layer="path-${index}"]`);
  if (!box.checked) box.click();
}

// The scan to open with: the one with the most beams that fit nothing seen before.
function strangest(run, method) {
  const fits = method.fits(), ranges = run.ranges(), count = run.angles.length;
  let most = 0, found = 0;
  for (let k = Math.min(20, run.rows.length - 1); k < run.rows.length; k++) {
    let misfits = 0;
    for (let i = 0; i < count; i++) if (!Number.isNaN(ranges[k * count + i]) && !fits(k, i)) misfits++;
    if (misfits > most) [most, found] = [misfits, k];
  }
  return found;
}

function robotFacts(run, method, k, seen) {
  const track = method.track, off = method.off(), [x, y, yaw] = seen.pose;
  return [
    ["pose", `${x.toFixed(2)} m, ${y.toFixed(2)} m, ${degrees(yaw).toFixed(1)}°`],
    ["position error", off && metres(off[k])],
    ["verdict", track && VERDICTS[track.verdict[k]]],
    ["matched points", track && String(track.matches[k])],
    ["step error", track && track.error && Number.isFinite(track.error[k]) ? metres(track.error[k]) : null],
    ["beams", `${seen.fits} fit what was seen before, ${seen.misfits} do not`],
    ["95 % ellipse", seen.spread ? `± ${metres(seen.spread.long)} × ${metres(seen.spread.short)}, ${method.spread.what}` : "none: the method says nothing here"],
    ["tilt", run.tilt ? run.tilt.source : "not recorded"],
  ];
}

start();
