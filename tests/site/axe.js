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
  // Of the texts that look alike, in their colour and in all that lies behind them, three are enough; axe says nothing of one
  // that is hidden or has one letter, nor of an element without a text of its own, but asks itself so for each of thousands.
  const grounds = new Map(), seen = {};
  function ground(element) {
    if (element && !grounds.has(element)) {
      const { backgroundColor, backgroundImage, opacity, textShadow } = getComputedStyle(element);
      const own = [backgroundColor, backgroundImage, opacity, textShadow].join();
      const behind = ground(element.parentElement);
      grounds.set(element, own === "rgba(0, 0, 0, 0),none,1,none" ? behind : own + behind);
    }
    return grounds.get(element) ?? "";
  }
  for (const element of document.body.querySelectorAll("*")) {
    const texts = [...element.childNodes].filter((part) => part.nodeType === Node.TEXT_NODE).map((part) => part.data.trim());
    const letters = Math.max(0, ...texts.map((text) => text.length));
    const silent = !element.checkVisibility() || letters === 1 || (letters === 0 && !element.matches("input, select, textarea"));
    element.toggleAttribute("data-alike", silent);
    if (silent || letters === 0) continue;
    const { color, fontSize, fontWeight, position } = getComputedStyle(element);
    const look = [color, fontSize, fontWeight, position, ground(element)].join();
    seen[look] = (seen[look] ?? 0) + 1;
    element.toggleAttribute("data-alike", seen[look] > 3);
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
