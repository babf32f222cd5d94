// Files of packed arrays (livefiles.py): uint32 length of a JSON header {config, arrays: [[name, shape, kind], ...]}, the
// header, the numbers.

const KINDS = { half: Uint16Array, single: Float32Array, short: Uint16Array, byte: Uint8Array };

// {config, tensors: name -> {shape, data}}
export function readArrays(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const { config, arrays } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const tensors = {};
  let at = 4 + length;
  for (const [name, shape, kind] of arrays) {
    const Kind = KINDS[kind],
      size = Kind.BYTES_PER_ELEMENT * shape.reduce((a, b) => a * b, 1),
      numbers = new Kind(buffer.slice(at, at + size));
    tensors[name] = { shape, data: kind === "half" ? Float32Array.from(numbers, half) : numbers };
    at += size;
  }
  return { config, tensors };
}

// the number of an IEEE half
function half(bits) {
  const sign = bits & 0x8000 ? -1 : 1,
    exponent = (bits >> 10) & 31,
    fraction = bits & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  return exponent === 31 ? (fraction ? NaN : sign * Infinity) : sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
}
