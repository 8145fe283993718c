// Reads what robot_retarget.tools.view.web.show wrote.

const NONE = { i2: -32768, i4: -2147483648 };

/** The show that is embedded in the page. */
export async function embedded() {
  const bytes = Uint8Array.from(atob(document.getElementById("data").textContent), (c) => c.charCodeAt(0));
  return decoded(new Blob([bytes]).stream());
}

/** A stream of packed bytes as a header whose arrays are {shape, values}. */
export async function decoded(stream) {
  const buffer = await new Response(stream.pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return unpacked(header, buffer, 4 + length);
}

function unpacked(value, buffer, start) {
  if (value === null || typeof value !== "object") return value;
  if (Array.isArray(value)) return value.map((item) => unpacked(item, buffer, start));
  if ("step" in value && "offset" in value) return array(value, buffer, start);
  return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, unpacked(item, buffer, start)]));
}

function array({ type, step, shape, offset }, buffer, start) {
  const count = shape.reduce((product, size) => product * size, 1);
  const whole = new (type === "i2" ? Int16Array : Int32Array)(buffer, start + offset, count);
  const width = shape[0] ? count / shape[0] : 0;
  const values = new Float32Array(count);
  for (let k = 0; k < count; k++) {
    if (k >= width) whole[k] += whole[k - width]; // wraps, as the differences did
    values[k] = whole[k] === NONE[type] ? NaN : whole[k] * step;
  }
  return { shape, values, width };
}

/** Row t (a fraction goes straight between two frames) of an array, into `out`. */
export function row(array, t, out) {
  const { values, width, shape } = array;
  const at = Math.min(Math.max(t, 0), shape[0] - 1);
  const left = Math.min(Math.floor(at), Math.max(shape[0] - 2, 0));
  const right = Math.min(left + 1, shape[0] - 1);
  const share = at - left;
  for (let k = 0; k < width; k++) {
    const a = values[left * width + k], b = values[right * width + k];
    out[k] = share === 0 || a === b ? a : share === 1 ? b : a + (b - a) * share;
  }
  return out;
}
