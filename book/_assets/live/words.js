// Numbers as read-outs have them.

export const short = (x) =>
  x !== 0 && (Math.abs(x) < 0.001 || Math.abs(x) >= 1e5) ? x.toExponential(2) : String(Number(x.toPrecision(4)));

export const gap = (x) => x.toExponential(1);
