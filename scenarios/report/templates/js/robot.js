// The robot at one scan: its outline, the scan as it saw it, which beams fit, how sure it is of its place.
const BODY = [[0.27, 0], [0.15, 0.2], [-0.27, 0.2], [-0.27, -0.2], [0.15, -0.2]];
const CHI2_95 = 5.991; // two degrees of freedom

function makeRobot(run, renderer) {
  const line = (options) => L.polyline([], { renderer, interactive: false, ...options });
  const beams = { fits: line({ weight: 1, opacity: 0.3 }), misfits: line({ weight: 1, opacity: 0.45 }) };
  const dots = { fits: L.layerGroup(), misfits: L.layerGroup() };
  const scan = L.layerGroup([beams.fits, beams.misfits, dots.fits, dots.misfits]);
  const body = L.polygon([], { renderer, interactive: false, weight: 2, fillOpacity: 0.35 });
  const ring = line({ weight: 2 });
  const large = line({ weight: 1.2, dashArray: "4 4" });
  const ellipse = L.layerGroup([ring, large]);
  const pool = { fits: [], misfits: [] };

  const paint = (method) => {
    for (const kind of ["fits", "misfits"]) {
      beams[kind].setStyle({ color: colour(`--${kind}`) });
      pool[kind].forEach((dot) => dot.setStyle({ fillColor: colour(`--${kind}`) }));
    }
    body.setStyle({ color: colour("--ink"), fillColor: colour(method.colour) });
    ring.setStyle({ color: colour("--ink") });
    large.setStyle({ color: colour("--ink") });
  };

  const putDots = (kind, ends) => {
    const spare = pool[kind];
    while (spare.length < ends.length) {
      spare.push(L.circleMarker([0, 0], { renderer, interactive: false, stroke: false, radius: 2.2, fillOpacity: 1, fillColor: colour(`--${kind}`) }));
    }
    spare.forEach((dot, i) => {
      if (i < ends.length) {
        dot.setLatLng(ends[i]);
        if (!dots[kind].hasLayer(dot)) dots[kind].addLayer(dot);
      } else if (dots[kind].hasLayer(dot)) dots[kind].removeLayer(dot);
    });
  };

  const move = (method, k) => {
    const pose = poseAt(method.poses, k);
    body.setLatLngs(BODY.map((corner) => { const [x, y] = compose(pose, [...corner, 0]); return at(x, y); }));
    const seen = endsOf(run, method, k, pose);
    for (const kind of ["fits", "misfits"]) {
      beams[kind].setLatLngs(seen[kind].map((end) => [seen.origin, end]));
      putDots(kind, seen[kind]);
    }
    const spread = spreadAt(method, k);
    ring.setLatLngs(spread ? spread.outline(pose, 1) : []);
    large.setLatLngs(spread ? spread.outline(pose, 10) : []);
    return { pose, spread, fits: seen.fits.length, misfits: seen.misfits.length };
  };
  return { scan, body, ellipse, move, paint };
}

// Where the beams of a scan end on the map, apart by whether they fit what was seen before.
function endsOf(run, method, k, pose) {
  const [x, y, yaw] = compose(pose, run.mount);
  const ranges = run.ranges(), fits = method.fits(), count = run.angles.length;
  const seen = { origin: at(x, y), fits: [], misfits: [] };
  for (let i = 0; i < count; i++) {
    const range = ranges[k * count + i];
    if (Number.isNaN(range)) continue;
    const bearing = yaw + run.angles[i];
    const end = at(x + range * Math.cos(bearing), y + range * Math.sin(bearing));
    (fits(k, i) ? seen.fits : seen.misfits).push(end);
  }
  return seen;
}

// The 95 % ellipse: its half axes [m] and its outline, `times` as large.
function spreadAt(method, k) {
  if (!method.spread) return null;
  const [xx, xy, yy] = method.spread.values.subarray(3 * k, 3 * k + 3);
  if (!Number.isFinite(xx + xy + yy)) return null;
  const middle = (xx + yy) / 2, apart = Math.hypot((xx - yy) / 2, xy);
  if (middle - apart < 0) return null; // not a covariance
  const [long, short] = [middle + apart, middle - apart].map((value) => Math.sqrt(CHI2_95 * value));
  const turn = 0.5 * Math.atan2(2 * xy, xx - yy);
  const outline = ([x, y], times) => Array.from({ length: 49 }, (_, i) => {
    const a = 2 * Math.PI * i / 48, u = times * long * Math.cos(a), v = times * short * Math.sin(a);
    return at(x + u * Math.cos(turn) - v * Math.sin(turn), y + u * Math.sin(turn) + v * Math.cos(turn));
  });
  return { long, short, outline };
}
