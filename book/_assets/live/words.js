// Numbers as read-outs have them.

export const short = (x) =>
  x !== 0 && (Math.abs(x) < 0.001 || Math.abs(x) >= 1e5) ? x.toExponential(2) : String(Number(x.toPrecision(4)));

// 10 to the whole number k
export const ten = (k) => "10" + [...String(k)].map((c) => (c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c])).join("");

// with three digits
export function three(x) {
  if (x === 0 || Math.abs(x) >= 1e-4) return String(Number(x.toPrecision(3)));
  const [digits, power] = x.toExponential(2).split("e");
  return `${digits} × ${ten(Number(power))}`;
}

// a distance, with the digits that a reader can use
export const off = (x) => (x < 0.01 ? "< 0.01" : x.toFixed(x < 1 ? 2 : 1));

export const gap = (x) => x.toExponential(1);
