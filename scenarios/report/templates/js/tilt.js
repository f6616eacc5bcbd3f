// The robot from the side and from behind: pitch is nose down, roll is left side up.
const SIDE = { width: 430, height: 124, floor: 90, x: 60, metre: 62 };
const FAN = 8 * Math.PI / 180; // beams this near the heading are drawn

function makeTilt(svg, run) {
  svg.setAttribute("viewBox", `0 0 ${SIDE.width} ${SIDE.height}`);
  const height = run.height ?? 0.3;
  return (k) => {
    const parts = [makeSvg("line", { x1: 0, y1: SIDE.floor, x2: SIDE.width, y2: SIDE.floor, style: "stroke: var(--soft); stroke-width: 1.5" })];
    if (!run.tilt) parts.push(makeSvg("text", { x: 8, y: 16 }, "the recording has no attitude"));
    const [roll, pitch] = run.tilt ? [run.tilt.angles[2 * k], run.tilt.angles[2 * k + 1]] : [0, 0];
    parts.push(...fromTheSide(run, k, roll, pitch, height), ...fromBehind(roll));
    if (run.tilt) {
      const [nose, left] = [degrees(pitch), degrees(roll)];
      parts.push(makeSvg("text", { x: 8, y: 118 }, `pitch ${nose.toFixed(1)}° ${nose >= 0 ? "nose down" : "nose up"}`));
      parts.push(makeSvg("text", { x: 330, y: 118 }, `roll ${left.toFixed(1)}°`));
    }
    svg.replaceChildren(...parts);
  };
}

const BOX = "fill: var(--panel); stroke: var(--ink); stroke-width: 1.5";

function fromTheSide(run, k, roll, pitch, height) {
  const group = makeSvg("g", { transform: `rotate(${degrees(pitch)} ${SIDE.x} ${SIDE.floor})` });
  const top = SIDE.floor - height * SIDE.metre;
  const room = pitch > 0 ? height * SIDE.metre / Math.tan(pitch) : (top - 24) / Math.sin(-pitch); // to the floor, to the words
  const ray = pitch === 0 ? 230 : Math.min(230, room);
  group.append(
    makeSvg("rect", { x: SIDE.x - 20, y: SIDE.floor - 11, width: 40, height: 11, rx: 5, style: BOX }),
    makeSvg("rect", { x: SIDE.x - 6, y: top - 4, width: 12, height: 8, style: "fill: var(--ink)" }),
    makeSvg("line", { x1: SIDE.x, y1: top, x2: SIDE.x, y2: SIDE.floor - 11, style: "stroke: var(--ink)" }),
    makeSvg("line", { x1: SIDE.x, y1: top, x2: SIDE.x + ray, y2: top, style: "stroke: var(--strong); stroke-dasharray: 5 4" }),
  );
  const parts = [makeSvg("text", { x: 8, y: 16 }, "from the side, what beams ahead met"), group];
  if (!run.tilt) return [group];
  const ranges = run.ranges(), count = run.angles.length;
  for (let i = 0; i < count; i++) {
    const angle = run.angles[i] + run.mount[2], range = ranges[k * count + i];
    if (Math.abs(angle) > FAN || Number.isNaN(range)) continue;
    const c = Math.cos(angle), s = Math.sin(angle);
    const ahead = range * (Math.cos(pitch) * c + Math.sin(pitch) * Math.sin(roll) * s);
    const up = range * (-Math.sin(pitch) * c + Math.cos(pitch) * Math.sin(roll) * s);
    const x = SIDE.x + height * Math.sin(pitch) * SIDE.metre + ahead * SIDE.metre;
    const y = SIDE.floor - (height * Math.cos(pitch) + up) * SIDE.metre;
    if (x < 310) parts.push(makeSvg("circle", { cx: x, cy: y, r: 2.4, style: "fill: var(--misfits)" }));
  }
  return parts;
}

function fromBehind(roll) {
  const x = 370, pivot = SIDE.floor - (Math.abs(roll) > Math.PI / 2 ? 9.5 : 0); // on its back it lies on the floor
  const group = makeSvg("g", { transform: `rotate(${degrees(roll)} ${x} ${pivot})` });
  group.append(
    makeSvg("rect", { x: x - 16, y: SIDE.floor - 11, width: 8, height: 11, style: BOX }),
    makeSvg("rect", { x: x + 8, y: SIDE.floor - 11, width: 8, height: 11, style: BOX }),
    makeSvg("rect", { x: x - 14, y: SIDE.floor - 15, width: 28, height: 7, style: BOX }),
    makeSvg("line", { x1: x - 40, y1: SIDE.floor - 19, x2: x + 40, y2: SIDE.floor - 19, style: "stroke: var(--strong); stroke-dasharray: 5 4" }),
  );
  return [makeSvg("text", { x: 330, y: 16 }, "from behind"), group];
}
