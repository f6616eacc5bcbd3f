// Poses [x, y, yaw]: T_ab maps coordinates of b into a.
function compose([x, y, yaw], [bx, by, turn]) {
  const c = Math.cos(yaw), s = Math.sin(yaw);
  return [x + c * bx - s * by, y + s * bx + c * by, yaw + turn];
}

function moved([x, y, yaw], points) {
  const c = Math.cos(yaw), s = Math.sin(yaw);
  const found = new Float32Array(points.length);
  for (let i = 0; i < points.length; i += 2) {
    found[i] = x + c * points[i] - s * points[i + 1];
    found[i + 1] = y + s * points[i] + c * points[i + 1];
  }
  return found;
}

const degrees = (angle) => angle * 180 / Math.PI;
