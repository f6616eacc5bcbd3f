// Typed arrays from base64. What stands for "nothing" in an integer type becomes NaN.
const KINDS = { f4: Float32Array, i2: Int16Array, u2: Uint16Array, u1: Uint8Array };
const GAPS = { i2: -32768, u2: 65535, u1: 255 };

function bytes(text) {
  const raw = atob(text);
  const found = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) found[i] = raw.charCodeAt(i);
  return found;
}

function numbers(packed) {
  if (!packed) return null;
  const whole = new KINDS[packed.kind](bytes(packed.data).buffer);
  if (packed.kind === "f4") return whole;
  const gap = GAPS[packed.kind];
  const values = new Float32Array(whole.length);
  for (let i = 0; i < whole.length; i++) values[i] = whole[i] === gap ? NaN : whole[i] * packed.scale;
  return values;
}

// A function (row, column) -> bool.
function flags(packed) {
  const data = bytes(packed.data);
  return (row, column) => (data[row * packed.row + (column >> 3)] >> (7 - (column & 7)) & 1) === 1;
}
