// Names and numbers as labels say them.

const SIDES = { l: "left", r: "right" };

/** A keypoint's name in words: "l_hand" is the left hand. */
export function worded(keypoint) {
  const [side, ...rest] = keypoint.split("_");
  return SIDES[side] && rest.length ? [SIDES[side], ...rest].join(" ") : keypoint.replaceAll("_", " ");
}

/** A length [m] in centimetres. */
export function inCm(metres) {
  return `${(100 * metres).toFixed(1)} cm`;
}

/** How near two links are [m], and when they are predicted to touch [s], NaN if never. */
export function nearness(distance, wait, touching) {
  if (touching) return "touching";
  const apart = `${inCm(distance)} apart`;
  return Number.isFinite(wait) ? `contact predicted in ${wait.toFixed(2)} s, ${apart}` : apart;
}

/** An interval [m] that an edge asks for. */
export function interval(low, high) {
  if (low === high) return inCm(low);
  return Number.isFinite(high) ? `${(100 * low).toFixed(1)} to ${inCm(high)}` : `at least ${inCm(low)}`;
}
