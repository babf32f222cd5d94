// A cortical surface as a page has it: positions in mm, triangles, and its vertices' places in the disk.
import { readArrays } from "./files.js";
import { fromPicture, toPicture } from "./radius.js";

const CELLS = 96; // a side of the grid, in the picture's coordinates, that finds the triangle of a point
export class Hemisphere {
  constructor(buffer) {
    const { config, tensors } = readArrays(buffer),
      { faces, shade } = tensors;
    Object.assign(this, { ...config, faces: faces.data, shade: shade.data, V: shade.data.length, F: faces.data.length / 3 });
    for (const [name, [low, step]] of Object.entries(config.ranges)) {
      this[name] = Float32Array.from(tensors[name].data, (value) => low + step * value);
    }
    this.fromPicture = fromPicture(config.radius);
    this.toPicture = toPicture(config.radius);
    this.placeInDisk();
  }

  // x, y (V): the vertices in the disk itself, where triangles are straight
  placeInDisk() {
    this.x = new Float64Array(this.V);
    this.y = new Float64Array(this.V);
    for (let v = 0; v < this.V; v++) {
      [this.x[v], this.y[v]] = this.fromPicture([this.places[2 * v], this.places[2 * v + 1]]);
    }
  }

  cell(c) {
    return Math.min(CELLS - 1, Math.max(0, Math.floor(((c + 1) / 2) * CELLS)));
  }

  // the triangles of each cell of the grid, those beside it among them, since triangles are bent in the picture
  get cells() {
    if (this._cells) return this._cells;
    this._cells = Array.from({ length: CELLS * CELLS }, () => []);
    for (let t = 0; t < this.F; t++) {
      const corners = this.faces.subarray(3 * t, 3 * t + 3),
        ends = [0, 1].map((k) => {
          const along = Array.from(corners, (v) => this.places[2 * v + k]);
          return [this.cell(Math.min(...along) - 1 / CELLS), this.cell(Math.max(...along) + 1 / CELLS)];
        });
      for (let i = ends[1][0]; i <= ends[1][1]; i++) {
        for (let j = ends[0][0]; j <= ends[0][1]; j++) this._cells[i * CELLS + j].push(t);
      }
    }
    return this._cells;
  }

  // The triangle of a point of the disk and its weights there; beyond the rim's chords, of the nearest point within.
  locate(x, y) {
    const [u, v] = this.toPicture([x, y]);
    let best = { least: -Infinity };
    for (const t of this.cells[this.cell(v) * CELLS + this.cell(u)]) {
      const weights = this.weightsIn(t, x, y),
        least = Math.min(...weights);
      if (least > best.least) best = { t, weights, least };
      if (least >= 0) break;
    }
    const kept = best.weights.map((w) => Math.max(w, 0)),
      sum = kept[0] + kept[1] + kept[2];
    return { corners: this.faces.subarray(3 * best.t, 3 * best.t + 3), weights: kept.map((w) => w / sum) };
  }

  weightsIn(t, x, y) {
    const [a, b, c] = this.faces.subarray(3 * t, 3 * t + 3),
      bx = this.x[b] - this.x[a],
      by = this.y[b] - this.y[a],
      cx = this.x[c] - this.x[a],
      cy = this.y[c] - this.y[a];
    const twice = bx * cy - by * cx,
      second = ((x - this.x[a]) * cy - (y - this.y[a]) * cx) / twice,
      third = (bx * (y - this.y[a]) - by * (x - this.x[a])) / twice;
    return [1 - second - third, second, third];
  }

  // [x, y, z] on the surface, or on another with its triangles, of a place that `locate` gave
  at({ corners, weights }, vertices = this.vertices) {
    return [0, 1, 2].map((k) => corners.reduce((sum, v, i) => sum + weights[i] * vertices[3 * v + k], 0));
  }
}
