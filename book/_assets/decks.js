// The slides of book/builder/decks.py, each a section in a section of its own, as nbconvert writes them. An explorable keeps its
// keys for itself, but Page Up and Page Down, and is as large as its slide lets it be.
const HEIGHT = 720,
  live = (element) => element?.closest(".qc-live");

function fit(root) {
  const section = root.closest("section");
  root.style.setProperty("--size", 1);
  if (!section.classList.contains("present")) return;
  const scale = section.getBoundingClientRect().height / section.offsetHeight,
    from = ({ top }) => (top - section.getBoundingClientRect().top) / scale,
    room = HEIGHT - 12 - from(root.getBoundingClientRect());
  for (let size = 0.98; size > 0.4 && root.getBoundingClientRect().height / scale > room; size -= 0.02)
    root.style.setProperty("--size", size);
}

const fitAll = () => document.querySelectorAll(".qc-live").forEach(fit);
if (matchMedia("(min-width: 40rem)").matches) { // a telephone shows the slides below each other
  Reveal.initialize({
    width: 1280,
    height: HEIGHT,
    margin: 0,
    center: false,
    hash: true,
    controlsLayout: "edges",
    slideNumber: "c/t",
    transition: "none",
    touch: false,
    keyboardCondition: () => !live(document.activeElement),
  });
  // Page Up and Page Down, which a presenter's remote sends, turn the slide and leave the explorable.
  const turn = { PageUp: () => Reveal.prev(), PageDown: () => Reveal.next() };
  const leave = (event) => {
    if (!turn[event.key] || !live(document.activeElement)) return;
    event.preventDefault();
    event.stopPropagation();
    document.activeElement.blur();
    turn[event.key]();
  };
  addEventListener("keydown", leave, { capture: true });
  Reveal.on("ready", fitAll);
  Reveal.on("slidechanged", fitAll);
  const watcher = new ResizeObserver(fitAll); // tables grow as answers come
  for (const root of document.querySelectorAll(".qc-live")) watcher.observe(root);
}
