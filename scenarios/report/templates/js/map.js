// The map: metres, x to the right, y up, one pane per kind of thing so that what matters lies on top.
const PANES = ["terrain", "smoke", "maps", "walls", "submaps", "paths", "stitches", "robot"];

const at = (x, y) => [y, x]; // Leaflet has latitude first

function makeMap(element) {
  const map = L.map(element, {
    crs: L.CRS.Simple, zoomSnap: 0.1, zoomDelta: 0.5, minZoom: -3, maxZoom: 9, wheelPxPerZoomLevel: 110,
    attributionControl: false, zoomControl: true,
  });
  L.control.scale({ imperial: false, maxWidth: 140 }).addTo(map);
  const renderers = {};
  PANES.forEach((name, i) => {
    const pane = map.createPane(name);
    pane.style.zIndex = 300 + 10 * i;
    if (name !== "stitches") pane.style.pointerEvents = "none";
    renderers[name] = L.canvas({ pane: name, padding: 0.3, tolerance: name === "stitches" ? 7 : 0 });
  });
  return { map, renderers };
}

function boundsOf(run) {
  const points = [];
  const corners = (map) => map && points.push(at(map.corners[0], map.corners[1]), at(map.corners[2], map.corners[3]));
  const walls = numbers(run.world.walls);
  if (walls) for (let i = 0; i < walls.length; i += 2) points.push(at(walls[i], walls[i + 1]));
  const best = run.methods.find((method) => method.name === run.best) || run.methods[0];
  if (!walls && best) corners(best.map);
  if (!points.length) {
    const path = run.truth || (best && best.poses) || new Float32Array([0, 0, 0]);
    for (let k = 0; k < path.length; k += 3) points.push(at(path[k], path[k + 1]));
  }
  return L.latLngBounds(points).pad(0.03);
}

function pathOf(poses) {
  const points = [];
  for (let k = 0; k < poses.length; k += 3) points.push(at(poses[k], poses[k + 1]));
  return points;
}
