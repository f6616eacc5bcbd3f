// What can be switched on and off: a layer is {id, label, group, on, build()}; built when first shown.
function worldLayers(run, renderers) {
  const layers = [];
  const add = (id, label, on, key, build) => layers.push({ id, label, on, key, group: "World", build });
  const { walls, terrain, smoke } = run.world;
  if (walls) add("walls", "true walls", true, ["line", "--wall"], () => wallLayer(numbers(walls), renderers.walls));
  if (run.truth) {
    add("truth", "true path", false, ["dash", "--ink"], () =>
      styled(L.polyline(pathOf(run.truth), { renderer: renderers.paths, weight: 1.5, dashArray: "5 4", interactive: false }), "--ink"));
  }
  if (terrain) add("terrain", `uneven ground, up to ${terrain.top.toFixed(2)} m`, false, ["field", "--ground"],
    () => new RasterLayer(terrain, fieldPaint("--ground"), { pane: "terrain" }));
  if (smoke) add("smoke", `smoke, up to ${smoke.top.toFixed(1)} /m`, false, ["field", "--smoke"],
    () => new RasterLayer(smoke, fieldPaint("--smoke"), { pane: "smoke" }));
  return layers;
}

function methodLayers(run, renderers) {
  return run.methods.flatMap((method, index) => {
    const first = method.name === run.best;
    const path = {
      id: `path-${index}`, label: `path of ${method.name}`, method, part: "path", on: first,
      build: () => styled(L.polyline(pathOf(method.poses),
        { renderer: renderers.paths, weight: 2, interactive: false }), method.colour),
    };
    if (!method.map) return [path];
    const map = {
      id: `map-${index}`, label: `map of ${method.name}`, method, part: "map", on: first,
      build: () => new RasterLayer(method.map, mapPaint(method.colour), { pane: "maps" }),
    };
    return [map, path];
  });
}

function wallLayer(ends, renderer) {
  const lines = [];
  for (let i = 0; i < ends.length; i += 4) lines.push([at(ends[i], ends[i + 1]), at(ends[i + 2], ends[i + 3])]);
  return styled(L.polyline(lines, { renderer, weight: 1.3, interactive: false }), "--wall");
}

// A layer that follows the theme.
function styled(layer, name, fill = null) {
  layer.repaint = () => layer.setStyle({ color: colour(name), ...(fill ? { fillColor: colour(fill) } : {}) });
  layer.repaint();
  return layer;
}

const together = (layers) => {
  const group = L.layerGroup(layers);
  group.repaint = () => layers.forEach((layer) => layer.repaint && layer.repaint());
  return group;
};

// Shows and hides layers as asked by checkboxes, and paints them anew when the theme changes.
function makeSwitches(map, layers) {
  const built = new Map();
  const show = (layer, on) => {
    layer.on = on;
    if (on && !built.has(layer.id)) built.set(layer.id, layer.build());
    const drawn = built.get(layer.id);
    if (!drawn) return;
    if (on) drawn.addTo(map); else drawn.remove();
  };
  layers.forEach((layer) => layer.on && show(layer, true));
  onTheme(() => built.forEach((drawn) => drawn.repaint && drawn.repaint()));
  return {
    show,
    rebuild(ids) {
      layers.filter((layer) => ids.includes(layer.id)).forEach((layer) => {
        const drawn = built.get(layer.id);
        if (drawn) drawn.remove();
        built.delete(layer.id);
        if (layer.on) show(layer, true);
      });
    },
  };
}
