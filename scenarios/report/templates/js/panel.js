// The panel of checkboxes beside the map, which is its legend too.
function key([kind, name, other]) {
  const svg = makeSvg("svg", { class: "key", viewBox: "0 0 24 12", "aria-hidden": "true" });
  const style = `stroke: var(${name}); stroke-width: 2.5; fill: none`;
  if (kind === "field") svg.append(makeSvg("rect", { x: 2, y: 1, width: 20, height: 10, rx: 2, style: `fill: var(${name}); opacity: .6` }));
  else if (kind === "dots") [name, other].forEach((c, i) => svg.append(makeSvg("circle", { cx: 7 + 10 * i, cy: 6, r: 3.5, style: `fill: var(${c})` })));
  else if (kind === "ring") svg.append(makeSvg("ellipse", { cx: 12, cy: 6, rx: 9, ry: 4.5, style }));
  else if (kind === "cross") svg.append(makeSvg("path", { d: "M8 2 L16 10 M16 2 L8 10", style }));
  else if (kind === "many") ["--c0", "--c1", "--c5"].forEach((c, i) => svg.append(makeSvg("rect", { x: 2 + 7 * i, y: 2, width: 6, height: 8, style: `fill: var(${c})` })));
  else svg.append(makeSvg("line", { x1: 1, y1: 6, x2: 23, y2: 6, style: kind === "dash" ? `${style}; stroke-dasharray: 4 3` : style }));
  return svg;
}

function checkbox(layer, switches, attributes = {}) {
  const box = make("input", { type: "checkbox", "data-layer": layer.id, ...attributes });
  box.checked = layer.on;
  box.addEventListener("change", () => switches.show(layer, box.checked));
  return box;
}

function simpleGroup(title, layers, switches) {
  return make("fieldset", {}, make("legend", {}, title),
    ...layers.map((layer) => make("label", {}, checkbox(layer, switches), key(layer.key), layer.label)));
}

function methodGroup(run, layers, switches) {
  const grid = make("div", { class: "methods-grid" }, make("span", { class: "head" }),
    make("span", { class: "head" }, "map"), make("span", { class: "head" }, "path"));
  run.methods.forEach((method) => {
    const parts = layers.filter((layer) => layer.method === method);
    const box = (part) => {
      const layer = parts.find((one) => one.part === part);
      return layer ? checkbox(layer, switches, { "aria-label": layer.label }) : make("span", { title: "too large to draw" }, "–");
    };
    const swatch = make("span", { class: "swatch", style: `--colour: var(${method.colour})` });
    grid.append(make("span", { title: method.name }, swatch, method.name), box("map"), box("path"));
  });
  return make("fieldset", {}, make("legend", {}, "Methods"), grid);
}
