// The slides of book/builder/decks.py, each a section in a section of its own, as nbconvert writes them. An explorable is
// as large as its slide lets it be, and keeps its keys for itself.
const HEIGHT = 720,
  live = (element) => element?.closest(".qc-live");

function fit(root) {
  const section = root.closest("section");
  root.style.zoom = 1;
  if (!section.classList.contains("present")) return;
  const scale = section.getBoundingClientRect().height / section.offsetHeight,
    from = ({ top }) => (top - section.getBoundingClientRect().top) / scale,
    room = HEIGHT - 12 - from(root.getBoundingClientRect());
  let zoom = 1;
  for (let tries = 0; tries < 8; tries++) { // what is smaller has more room to its sides, and is laid out anew
    const height = root.getBoundingClientRect().height / scale;
    if (height <= room) return;
    root.style.zoom = zoom *= Math.min(0.98, room / height);
  }
}

// Words that are too many for a slide are smaller.
function fitWords(section) {
  const words = section.querySelectorAll(":scope > .jp-MarkdownCell:not(:first-child)");
  for (let zoom = 1; zoom > 0.6; zoom -= 0.05) {
    for (const cell of words) cell.style.zoom = zoom;
    if (section.scrollHeight <= HEIGHT) return;
  }
}

function fitAll() {
  document.querySelectorAll("section section.present").forEach(fitWords);
  document.querySelectorAll(".qc-live").forEach(fit);
}
Reveal.initialize({
  width: 1280,
  height: HEIGHT,
  margin: 0.02,
  center: false,
  hash: true,
  slideNumber: "c/t",
  transition: "none",
  touch: false,
  keyboardCondition: () => !live(document.activeElement),
});
Reveal.on("ready", fitAll);
Reveal.on("slidechanged", fitAll);
const watcher = new ResizeObserver(fitAll); // tables grow as answers come
for (const root of document.querySelectorAll(".qc-live")) watcher.observe(root);
