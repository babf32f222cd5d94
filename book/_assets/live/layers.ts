// The two inner loops of layers.js in AssemblyScript, four numbers at a time. Arguments are byte offsets, or counts.

// e^x to single precision, |x| cut to 87 (Cephes)
// @ts-ignore: a decorator
@inline function exponential(x: v128): v128 {
  x = f32x4.max(f32x4.min(x, f32x4.splat(87)), f32x4.splat(-87));
  const k = f32x4.nearest(f32x4.mul(x, f32x4.splat(1.44269504088896341)));
  let r = f32x4.sub(x, f32x4.mul(k, f32x4.splat(0.693359375)));
  r = f32x4.sub(r, f32x4.mul(k, f32x4.splat(-2.12194440e-4)));
  let p = f32x4.splat(1.9875691500e-4);
  p = f32x4.add(f32x4.mul(p, r), f32x4.splat(1.3981999507e-3));
  p = f32x4.add(f32x4.mul(p, r), f32x4.splat(8.3334519073e-3));
  p = f32x4.add(f32x4.mul(p, r), f32x4.splat(4.1665795894e-2));
  p = f32x4.add(f32x4.mul(p, r), f32x4.splat(1.6666665459e-1));
  p = f32x4.add(f32x4.mul(p, r), f32x4.splat(5.0000001201e-1));
  p = f32x4.add(f32x4.add(f32x4.mul(f32x4.mul(p, r), r), r), f32x4.splat(1));
  return f32x4.mul(p, i32x4.shl(i32x4.add(i32x4.trunc_sat_f32x4_s(k), i32x4.splat(127)), 23));
}

// to = from / (1 + e^-from), count a multiple of 4
export function silu(from: usize, to: usize, count: i32): void {
  for (let i: usize = 0; i < <usize>count << 2; i += 16) {
    const x = v128.load(from + i);
    v128.store(to + i, f32x4.div(x, f32x4.add(f32x4.splat(1), exponential(f32x4.neg(x)))));
  }
}

// @ts-ignore: a decorator
@inline function put(to: usize, a: v128, b: v128, add: i32): void {
  if (add) {
    a = f32x4.add(a, v128.load(to));
    b = f32x4.add(b, v128.load(to, 16));
  }
  v128.store(to, a);
  v128.store(to, b, 16);
}

// see layers.js: blocks of 6 pixels by 8 channels stay in registers
export function convolve(
  x: usize, rowBytes: usize, inputs: i32, kernel: i32, step: i32, weight: usize, bias: usize, out: usize,
  height: i32, width: i32, outputs: i32, add: i32,
): void {
  const px = <usize>(inputs * step) << 2, run = kernel * inputs, next = <usize>outputs << 2;
  for (let o = 0; o < outputs; o += 8) {
    const first = weight + (<usize>(o * kernel * kernel * inputs) << 2);
    const low = v128.load(bias + (<usize>o << 2)), high = v128.load(bias + (<usize>o << 2), 16);
    for (let i = 0; i < height; i++) {
      for (let j = 0; j < width; j += 6) {
        let a0 = low, a1 = high, b0 = low, b1 = high, c0 = low, c1 = high;
        let d0 = low, d1 = high, e0 = low, e1 = high, f0 = low, f1 = high, at = first;
        for (let y = 0; y < kernel; y++) {
          let p = x + <usize>(i * step + y) * rowBytes + <usize>j * px;
          for (let t = 0; t < run; t++) {
            const u = v128.load(at), v = v128.load(at, 16);
            let q = v128.load32_splat(p);
            a0 = f32x4.add(a0, f32x4.mul(q, u)); a1 = f32x4.add(a1, f32x4.mul(q, v));
            q = v128.load32_splat(p + px);
            b0 = f32x4.add(b0, f32x4.mul(q, u)); b1 = f32x4.add(b1, f32x4.mul(q, v));
            q = v128.load32_splat(p + 2 * px);
            c0 = f32x4.add(c0, f32x4.mul(q, u)); c1 = f32x4.add(c1, f32x4.mul(q, v));
            q = v128.load32_splat(p + 3 * px);
            d0 = f32x4.add(d0, f32x4.mul(q, u)); d1 = f32x4.add(d1, f32x4.mul(q, v));
            q = v128.load32_splat(p + 4 * px);
            e0 = f32x4.add(e0, f32x4.mul(q, u)); e1 = f32x4.add(e1, f32x4.mul(q, v));
            q = v128.load32_splat(p + 5 * px);
            f0 = f32x4.add(f0, f32x4.mul(q, u)); f1 = f32x4.add(f1, f32x4.mul(q, v));
            p += 4;
            at += 32;
          }
        }
        const to = out + (<usize>(i * width + j) * <usize>outputs + <usize>o << 2);
        put(to, a0, a1, add);
        put(to + next, b0, b1, add);
        put(to + 2 * next, c0, c1, add);
        put(to + 3 * next, d0, d1, add);
        put(to + 4 * next, e0, e1, add);
        put(to + 5 * next, f0, f1, add);
      }
    }
  }
}
