// What axe-core calls serious or critical in this page or frame, or a part of it: a list of "rule: element". Two things would take most of
// its time: formulas, with some thousand elements, and the contrast of each word of code.
async ([rules, part]) => {
  // A formula is left out: its glyphs are hidden from screen readers, which get MathML; its colour is the text's.
  const formulas = [...document.querySelectorAll("mjx-container")].map((box) => [box, box.getAttribute("style"), box.getBoundingClientRect()])
    .map(([box, style, { width, height }]) => ({ box, style, parts: [...box.childNodes], size: `width: ${width}px; height: ${height}px` }));
  for (const { box, style, size } of formulas) {
    box.replaceChildren();
    box.setAttribute("style", `${style ?? ""}; display: inline-block; ${size}`);
  }
  // Of the words of code that look alike three are enough; axe says nothing of one that is hidden or has one letter.
  const looks = new Map(), seen = {};
  function look(element) {
    if (element && !looks.has(element)) {
      const { color, backgroundColor, fontSize, fontWeight, opacity, textShadow } = getComputedStyle(element);
      looks.set(element, [color, backgroundColor, fontSize, fontWeight, opacity, textShadow, look(element.parentElement)].join());
    }
    return looks.get(element);
  }
  for (const word of document.querySelectorAll("pre span")) {
    word.toggleAttribute("data-alike", seen[look(word)] >= 3 && !word.childElementCount);
    if (word.checkVisibility() && word.textContent.trim().length > 1) seen[look(word)] = (seen[look(word)] ?? 0) + 1;
  }
  axe.configure({ rules: [{ id: "color-contrast", selector: "*:not([data-alike])" }] });

  // Left out is what could not be found (test_accessible.py asks axe): 'region' is a moderate rule; and style sheets, which axe
  // fetches for itself, mistaking their addresses, are read by css-orientation-lock alone, which is experimental: axe passes over it.
  const found = await axe.run(part ?? document, {
    resultTypes: ["violations"], iframes: false, preload: { assets: ["media"] }, rules: { region: { enabled: false } }, ...rules,
  });
  for (const { box, style, parts } of formulas) {
    box.replaceChildren(...parts);
    if (style === null) box.removeAttribute("style"); else box.setAttribute("style", style);
  }
  return found.violations.filter(({ impact }) => ["serious", "critical"].includes(impact))
    .flatMap(({ id, nodes }) => nodes.map((node) => `${id}: ${node.target} ${node.html.slice(0, 120)}`));
}
