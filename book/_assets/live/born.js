// What a coefficient does to the disk, to first order (nets/born.py): tables `one` and `two`, one row a ring, for the
// smoothest eigenvectors ("modes") of the polar mesh.
import { zeros } from "./complex.js";

export class Born {
  // tensors: one, two (rings, modes, 2), kept (modes); cos, sin of the spokes' angles
  constructor({ mesh, cos, sin }, tensors) {
    Object.assign(this, { mesh, cos, sin, kept: tensors.kept.data, modes: tensors.kept.data.length });
    this.tables = Object.fromEntries(["one", "two"].map((name) => [name, Float64Array.from(tensors[name].data)]));
    this.angular = Int32Array.from(this.kept, (k) => Math.floor(k / mesh.rings)); // mode number
  }

  spoke(k) {
    return ((k % this.mesh.spokes) + this.mesh.spokes) % this.mesh.spokes;
  }

  // sum over frequencies m of waves (spokes, rings) exp(2 pi i m k / spokes), as a field of the rings' nodes
  fieldOf(waves, scale) {
    const {
        mesh: { rings, spokes },
        cos,
        sin,
      } = this,
      out = zeros(rings * spokes);
    for (let m = 0; m < spokes; m++) {
      for (let ring = 0; ring < rings; ring++) {
        const x = waves.x[m * rings + ring] * scale,
          y = waves.y[m * rings + ring] * scale;
        if (x === 0 && y === 0) continue;
        for (let k = 0, i = 0, to = ring * spokes; k < spokes; k++, to++, i = (i + m) % spokes) {
          out.x[to] += x * cos[i] - y * sin[i];
          out.y[to] += x * sin[i] + y * cos[i];
        }
      }
    }
    return out;
  }

  // displacements of the nodes by all coefficients of a field, complex pairs, to first order
  moved(c) {
    const {
        mesh: { rings, spokes },
        modes,
        angular,
        tables: { one, two },
      } = this,
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
    return this.fieldOf(waves, 1);
  }
}
