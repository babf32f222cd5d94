// What every explorable has: controls, pictures, read-outs, undo, reset, downloads, a link that carries the state, and a
// question with a guess. What it shows is a `spec`, one module each (explore_*.js); where it lives is a `host`: the
// static page (page.js) or JupyterLab (lab.js).
//
// spec: name, label, initial, controls, views, question, answer(state, host) -> answer or promise of it,
//       draw(pictures, state, answer), words(state, answer) -> the read-outs, data(state, answer) -> what JSON has;
//       where there is more to say: sentence(state, answer) -> {words, loud: 0 to 2}, under the first two pictures, above the
//       controls, with bars(state, answer) -> [{name, parts: [[words, value], ...], words}] and sides(state, answer), rows of a
//       table or null; the read-outs are folded then; rows(answer) of a table, afterwards(state, answer, host), fuller answers
//       one by one, for which an answer that is `partial` lets the read-outs wait; it is `failed`, and why, where they do not
//       come, onward {page, name, text, state(state, answer)}: a link to another explorable, with a state for it or null,
//       acts: buttons, words -> (state, answer) -> part of a state, or a text to be copied
// host: start (part of a state), save(state), tell(answer), file(name), worker(), ask(state) (the kernel) and
//       link(state), or null where there is none
import { buildControls, freshId, make, tableRows } from "./controls.js";
import { Picture, sheetOf } from "./picture.js";

const MOST_UNDO = 200;

export class Explorable {
  constructor(root, spec, host) {
    Object.assign(this, { root, spec, host, past: [], asked: 0, shown: 0 });
    this.state = { ...structuredClone(spec.initial), ...host.start };
    this.status = make("p", { className: "qc-live-status" });
    this.status.setAttribute("role", "status");
    this.table = make("table", { className: "qc-live-table" });
    this.controls = buildControls(spec.controls, (change, settled) => this.change(change, settled));
    this.pictures = spec.views.map((view) => new (view.picture ?? Picture)(view, spec.label));
    for (const picture of this.pictures) {
      picture.onDrag = (index, point, settled, by) => this.change(picture.view.drag(this.state, index, point, by), settled);
      picture.onChoose = () => this.update();
      picture.onClick = (label) => this.change(picture.view.click(this.state, label));
    }
    root.setAttribute("role", "group");
    root.setAttribute("aria-label", spec.label);
    const parts = [...(spec.sentence ? this.beside() : this.below()), this.buttons(), this.guess()];
    this.frame = make("div", { className: "qc-live-frame" }, ...parts);
  }

  // Everything replaces what stood there for readers without scripts, but only once there is an answer to show; early:
  // the first one, if it is there.
  async begin(early) {
    await this.update(true, early);
    this.root.replaceChildren(this.frame);
    this.root.dataset.ready = "yes";
    return this;
  }

  below() {
    this.numbers = this.status;
    return [this.gallery(this.pictures), ...this.controls.elements, this.status, this.table];
  }

  // the first two pictures side by side, below them a sentence and the controls, the others beside these; the read-outs folded
  beside() {
    const [one, two, ...others] = this.pictures,
      [controls, ...rare] = this.controls.elements;
    this.numbers = make("p", { className: "qc-live-numbers" });
    this.bars = make("div", { className: "qc-live-bars" });
    this.sides = make("table", { className: "qc-live-table" });
    return [
      make("div", { className: "qc-live-two" }, one.element, two.element),
      make(
        "div",
        { className: "qc-live-beside" },
        make("div", {}, this.status, controls, this.bars, this.sides),
        this.gallery(others),
      ),
      make("details", {}, make("summary", { textContent: "Numbers" }), this.numbers, this.table),
      ...rare,
    ];
  }

  gallery(pictures) {
    return make("div", { className: "qc-live-pictures" }, ...pictures.map((picture) => picture.element));
  }

  // part of a state, from a control, a drag, Python or undo; settled: the end of a movement
  change(part, settled = true, remember = true) {
    if (remember && !this.moving) {
      this.past.push(structuredClone(this.state));
      if (this.past.length > MOST_UNDO) this.past.shift();
    }
    this.moving = remember && !settled;
    Object.assign(this.state, part);
    this.undoButton.disabled = !this.past.length;
    if (settled) this.host.save(this.state);
    return this.update();
  }

  undo() {
    if (this.past.length) return this.change(this.past.pop(), true, false);
  }

  reset() {
    return this.change(structuredClone(this.spec.initial));
  }

  // Ask for the answer to the state; only the newest is shown, and an older one never after a newer one.
  async update(first = false, early) {
    const number = ++this.asked,
      state = structuredClone(this.state);
    this.controls.show(state);
    this.pictures.forEach((picture) => picture.handles(state));
    try {
      const answer = early ?? (await this.spec.answer(state, this.host));
      if (answer === null || number < this.shown) return;
      this.show(number, state, answer);
      if (this.spec.afterwards) this.complete(number, state, answer);
    } catch (error) {
      if (first) throw error;
      if (number < this.shown) return;
      this.say(`No picture for this: ${error.message}. The last one stays.`);
      this.announce(number);
    }
  }

  show(number, state, answer) {
    Object.assign(this, { shown: number, answer });
    this.controls.show(this.state); // an answer may bring what there is to choose from
    this.pictures.forEach((picture) => picture.handles(state)); // and what they stand on
    this.spec.draw(this.pictures, state, answer);
    this.report(state, answer);
    this.host.tell(this.spec.data(state, answer));
    if (this.onward) this.lead(this.spec.onward.state(state, answer));
    this.announce(number);
  }

  // the read-outs; those who hear them are told once they are whole
  report(state, answer) {
    this.status.ariaBusy = String(Boolean(answer.partial));
    this.numbers.textContent = this.spec.words(state, answer);
    if (this.spec.sentence) this.tell(state, answer);
    if (this.spec.rows) this.table.replaceChildren(...tableRows(this.spec.rows(answer)));
    this.pictures.forEach((picture) => picture.describe(this.status.textContent));
  }

  // what stands under the first two pictures
  tell(state, answer) {
    const { words, loud } = this.spec.sentence(state, answer),
      part = ([name, value], k) => {
        const element = make("span", { textContent: name, title: name, className: `qc-live-part${k}` });
        element.style.flexGrow = value;
        return element;
      };
    this.say(words);
    this.status.dataset.loud = loud;
    const bars = this.spec
      .bars(state, answer)
      .flatMap(({ name, parts, words }) => [
        make("div", { ariaHidden: "true" }, make("b", { textContent: name }), ...parts.map(part)),
        make("small", { textContent: words }),
      ]);
    this.bars.replaceChildren(...bars);
    this.sides.replaceChildren(...tableRows(this.spec.sides(state, answer) ?? []));
  }

  // the link to another explorable, with a state for it; none where the state is null
  lead(state) {
    this.onward.hidden = !state;
    if (state) this.onward.href = this.host.onward(this.spec.onward, state);
  }

  // for those who wait for an answer: its number, and that of the newest question
  announce(number) {
    this.root.dispatchEvent(new CustomEvent("qc-live-answer", { bubbles: true, detail: { number, of: this.asked } }));
  }

  // what comes later, while the answer is still the one that is shown
  async complete(number, state, answer) {
    try {
      for await (const fuller of this.spec.afterwards(state, answer, this.host)) {
        if (number !== this.asked) return;
        this.spec.draw(this.pictures, state, fuller);
        this.controls.show(this.state);
        if (this.answer.partial) this.report(state, fuller);
        this.answer = fuller;
        this.host.tell(this.spec.data(state, fuller));
      }
    } catch (error) {
      if (number !== this.asked || !this.answer.partial) return; // what is shown stays
      this.report(state, (this.answer = { ...this.answer, partial: false, failed: error.message }));
    }
  }

  say(words) {
    this.status.textContent = words;
  }

  buttons() {
    const button = (label, act) => {
      const element = make("button", { type: "button", textContent: label });
      element.addEventListener("click", act);
      return element;
    };
    this.undoButton = button("Undo", () => this.undo());
    this.undoButton.disabled = true;
    const row = make(
      "div",
      { className: "qc-live-buttons" },
      this.undoButton,
      button("Reset", () => this.reset()),
      button("Picture (PNG)", () => this.downloadPicture()),
      button("Data (JSON)", () => this.downloadData()),
    );
    if (this.host.link) row.append(button("Link to this state", () => this.copyLink()));
    if (this.host.onward && this.spec.onward) {
      this.onward = make("a", { textContent: this.spec.onward.text });
      row.append(this.onward);
    }
    for (const [words, act] of Object.entries(this.spec.acts ?? {})) {
      row.append(
        button(words, () => {
          const found = act(this.state, this.answer);
          if (typeof found === "string") this.copy(found);
          else this.change(found);
        }),
      );
    }
    if (this.host.ask) row.append(button("Ask the kernel", () => this.askKernel()));
    this.copied = make("pre", { className: "qc-live-copied", hidden: true, tabIndex: 0, ariaLabel: "copied text" });
    return make("div", {}, row, this.copied);
  }

  // a text to the clipboard, and below the buttons, where a browser forbids that
  async copy(text) {
    Object.assign(this.copied, { textContent: text, hidden: false });
    await navigator.clipboard?.writeText(text).catch(() => {});
  }

  guess() {
    const { question } = this.spec,
      id = freshId();
    const input = make("input", { id, type: "number", step: "any", required: true });
    const said = make("output", { className: "qc-live-truth" });
    const form = make(
      "form",
      { className: "qc-live-guess" },
      make("label", { htmlFor: id }, make("b", { textContent: "Predict, then move. " }), question.text),
      input,
      make("button", { textContent: "Compare" }),
      said,
    );
    let asked = null; // the state in which the guess was made: the reader may move before he compares
    input.addEventListener("input", () => (asked ??= structuredClone(this.state)));
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      said.textContent = "Comparing ...";
      const truth = Promise.resolve(question.truth(asked ?? structuredClone(this.state), this.host));
      asked = null;
      const told = (truth) => `You said ${Number(input.value)}; it is ${Number(truth.toPrecision(3))}. ${question.why}`;
      said.textContent = await truth.then(told, (error) => `Not compared: ${error.message}.`);
    });
    return form;
  }

  downloadPicture() {
    const sheet = sheetOf(this.pictures.map((picture) => picture.canvas).filter((canvas) => canvas.clientWidth));
    this.save(sheet.toDataURL("image/png"), "png");
  }

  downloadData() {
    const text = JSON.stringify(
      { page: this.spec.name, state: this.state, answer: this.spec.data(this.state, this.answer) },
      (_, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value),
      1,
    );
    this.save(`data:application/json,${encodeURIComponent(text)}`, "json");
  }

  save(address, kind) {
    make("a", { href: address, download: `${this.spec.name}.${kind}` }).click();
  }

  async copyLink() {
    const link = this.host.link(this.state);
    try {
      await navigator.clipboard.writeText(link);
      this.say(`Copied: ${link}`);
    } catch {
      this.say(`The link: ${link}`);
    }
  }

  async askKernel() {
    this.say("The kernel computes ...");
    try {
      this.say(this.spec.compare(this.answer, await this.host.ask(this.state)));
    } catch (error) {
      this.say(`The kernel has no answer: ${error.message}`);
    }
  }
}

// what of a state differs from where it starts
export function difference(state, initial) {
  return Object.fromEntries(
    Object.entries(state).filter(([name, value]) => JSON.stringify(value) !== JSON.stringify(initial[name])),
  );
}
