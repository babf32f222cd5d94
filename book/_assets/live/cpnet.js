// CP-Net, preset `best` (nets/cpnet.py): the first Gauss-Newton step, corrected by a U-Net, and looks from there.
import { zeros } from "./complex.js";
import { Link, Looks } from "./looks.js";
import { Spectrum } from "./spectrum.js";
import { partOf, UNet } from "./unet.js";

const SMALL = 1e-4; // a size of nu below which there is nothing to correct

export class CPNet {
  // network: {config, tensors} of the file; mesh: the polar mesh of its config
  constructor(mesh, layers, { config, tensors }) {
    const spectrum = new Spectrum(mesh, tensors);
    Object.assign(this, { mesh, config, spectrum, own: new Link(mesh, spectrum) });
    const { one, two, kept } = tensors;
    [this.one, this.two] = [one, two].map(({ data }) => Float64Array.from(data));
    Object.assign(this, { kept: kept.data, modes: kept.data.length });
    this.angular = Int32Array.from(this.kept, (k) => Math.floor(k / mesh.rings)); // mode number
    this.unet = new UNet(layers, partOf(tensors, "unet"), mesh.rings, mesh.spokes);
  }

  // nu at the vertices of the network's mesh, for landmarks p, q {x, y}, after so many looks at its map on `mesh`; null
  // once it is `stale`
  async run(p, q, { alpha, beta, gamma }, looks = this.config.looks, mesh = this.mesh, stale = () => false) {
    const ratios = [beta / alpha, gamma / alpha],
      start = this.start(p, q, ...ratios);
    return looks ? new Looks(this.link(mesh), p, q, ...ratios).run(start, looks, stale) : start;
  }

  // whether the weights are so stiff that the library begins at the Born step, without the U-Net
  isStiff({ beta, gamma }) {
    return gamma >= this.config.stiff * beta;
  }

  // the mesh that is mapped beside the network's own; the last one is kept
  link(mesh) {
    if (mesh === this.mesh) return this.own;
    if (this.last?.mesh !== mesh) this.last = new Link(mesh, this.spectrum);
    return this.last;
  }

  // nu (V) before any look
  start(p, q, b, g) {
    const begin = new Looks(this.own, p, q, b, g),
      { nu, wanted, left } = begin.born(),
      size = this.size(nu) + SMALL;
    this.show(nu, size, begin.places, [wanted, left]);
    const output = this.unet.run(this.conditions(b, g, p.x.length, size)),
      channels = this.unet.head.outputs,
      { spokes, V } = this.mesh,
      { cos, sin } = this.spectrum,
      out = zeros(V - 1);
    for (let i = 0; i < V - 1; i++) {
      const [u, v, s, t] = output.subarray(i * channels, i * channels + 4),
        x = nu.x[i + 1],
        y = nu.y[i + 1],
        k = (2 * (i % spokes)) % spokes;
      out.x[i] = x * (1 + u) - y * v + size * (s * cos[k] - t * sin[k]);
      out.y[i] = y * (1 + u) + x * v + size * (s * sin[k] + t * cos[k]);
    }
    return this.spectrum.centred(out);
  }

  // the root of mean |nu|^2
  size(nu) {
    const { spokes, V } = this.mesh;
    let sum = 0;
    for (let i = 0; i < V - 1; i++)
      sum += this.spectrum.area[Math.floor(i / spokes)] * (nu.x[i + 1] ** 2 + nu.y[i + 1] ** 2);
    return Math.sqrt(sum / Math.PI);
  }

  conditions(b, g, count, size) {
    const log = (x, [low, high]) => Math.min(Math.max(Math.log10(Math.max(x, 1e-12)), low), high);
    return [log(b, this.config.smooth), log(g, this.config.match) - 4, Math.log10(count / 100), Math.log10(size)];
  }

  // The U-Net's input: nu, what it does to the nodes, and at the landmarks where they should go, how many share a node,
  // and what nu leaves of that; the radius. Complex fields in the frame that turns with the spoke.
  show(nu, size, places, [wanted, left]) {
    const { rings, spokes, radius } = this.mesh,
      N = rings * spokes,
      { cos, sin } = this.spectrum,
      channels = this.unet.stem.inputs,
      x = this.unet.input;
    let channel = 0;
    x.fill(0);
    const turning = (values, turns, scale) => {
      for (let i = 0; i < N; i++) {
        const a = (turns * (i % spokes)) % spokes,
          u = scale * values.x[i],
          v = scale * values.y[i];
        x[i * channels + channel] = u * cos[a] + v * sin[a];
        x[i * channels + channel + 1] = v * cos[a] - u * sin[a];
      }
      channel += 2;
    };
    const plain = (value) => {
      for (let i = 0; i < N; i++) x[i * channels + channel] = value(i);
      channel++;
    };
    const { spread, count } = this.splat(places, wanted);
    turning({ x: nu.x.subarray(1), y: nu.y.subarray(1) }, 2, 0.3 / size);
    turning(this.moved(this.spectrum.coefficients(nu)), 1, 5);
    turning(spread, 1, 10);
    plain((i) => count[i]);
    turning(this.splat(places, left).spread, 1, 10);
    plain((i) => radius[1 + Math.floor(i / spokes)]);
  }

  // landmarks' values shared out to the nodes around them, and how many share a node
  splat(places, values) {
    const N = this.mesh.rings * this.mesh.spokes,
      spread = zeros(N),
      count = new Float64Array(N);
    places.forEach(({ corners, weights }, m) =>
      corners.forEach((v, k) => {
        if (v === 0) return;
        spread.x[v - 1] += weights[k] * values.x[m];
        spread.y[v - 1] += weights[k] * values.y[m];
        count[v - 1] += weights[k];
      }),
    );
    return { spread, count };
  }

  spoke(k) {
    const { spokes } = this.mesh;
    return ((k % spokes) + spokes) % spokes;
  }

  // displacements of the nodes by all coefficients of a field, complex pairs, to first order: tables `one` and `two`, one
  // row a ring, for the smoothest eigenvectors ("modes") of the polar mesh (nets/born.py)
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
