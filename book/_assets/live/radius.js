// A change of the disk's radius: cortex is drawn with one that follows its area, since the conformal disk crowds it.
// radius: {disk, image}, knots that rise from 0 to 1, linear between them; null for problems that need none.

function along(r, from, to) {
  let k = 1;
  while (k < from.length - 1 && from[k] < r) k++;
  return to[k - 1] + ((to[k] - to[k - 1]) * (r - from[k - 1])) / (from[k] - from[k - 1]);
}

function scaled([x, y], from, to) {
  const r = Math.hypot(x, y),
    factor = r > 0 ? along(Math.min(r, 1), from, to) / Math.min(r, 1) : 1;
  return [x * factor, y * factor];
}

// from the disk to the picture, and back: functions of a point
export const toPicture = (radius) => (point) => (radius ? scaled(point, radius.disk, radius.image) : point);
export const fromPicture = (radius) => (point) => (radius ? scaled(point, radius.image, radius.disk) : point);
