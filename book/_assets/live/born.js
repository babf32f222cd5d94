// What a coefficient does to the disk, to first order (nets/born.py): tables `one` and `two`, one row a ring, for the
// smoothest eigenvectors ("modes") of the polar mesh.
import { zeros } from "./complex.js";

export class Born {
  // tensors: one, two (rings, modes, 2), kept (modes)
  constructor(spectrum, { one, two, kept }) {
    Object.assign(this, { spectrum, kept: kept.data, modes: kept.data.length });
    [this.one, this.two] = [one, two].map(({ data }) => Float64Array.from(data));
    this.angular = Int32Array.from(this.kept, (k) => Math.floor(k / spectrum.mesh.rings)); // mode number
  }

  spoke(k) {
    const { spokes } = this.spectrum;
    return ((k % spokes) + spokes) % spokes;
  }

  // displacements of the nodes by all coefficients of a field, complex pairs, to first order
  moved(c) {
    const { spectrum, modes, angular, one, two } = this,
      { rings, spokes } = spectrum.mesh,
      waves = zeros(rings * spokes);
    for (let j = 0; j < rings; j++) {
      for (let n = 0; n < modes; n++) {
        const at = 2 * (j * modes + n),
          x = c[2 * this.kept[n]],
          y = c[2 * this.kept[n] + 1];
        const a = this.spoke(angular[n] - 1) * rings + j,
          b = this.spoke(3 - angular[n]) * rings + j;
        waves.x[a] += x * one[at] + y * one[at + 1];
        waves.y[a] += y * one[at] - x * one[at + 1];
        waves.x[b] += x * two[at] + y * two[at + 1];
        waves.y[b] += x * two[at + 1] - y * two[at];
      }
    }
    return spectrum.ofWaves(waves);
  }
}
