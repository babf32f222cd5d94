// What is wrong with the layout of this page: a list of sentences. A closed answer or cell is opened first.
async () => {
  const found = [];
  const say = (fault, element) => found.push(`${fault}: ${element.tagName.toLowerCase()} "${
    (element.getAttribute("aria-label") || element.textContent || element.src || "").trim().replace(/\s+/g, " ").slice(0, 70)}"`);
  const all = (selector) => [...document.querySelectorAll(`article :is(${selector})`)].filter((e) => e.getClientRects().length);
  const clips = (style) => style.overflowX !== "visible" || style.overflow !== "visible";
  const scrolls = (element) => ["auto", "scroll"].includes(getComputedStyle(element).overflowX);

  document.querySelectorAll("article details").forEach((e) => { e.open = true; });
  document.querySelectorAll("article .toggle-hidden").forEach((e) => e.classList.remove("toggle-hidden"));
  for (const _ of [1, 2]) await new Promise(requestAnimationFrame); // scrolling.js sees what was opened
  const root = document.documentElement;
  if (root.scrollWidth > root.clientWidth) found.push(`the page scrolls sideways: ${root.scrollWidth} > ${root.clientWidth}`);

  // A box that is made to scroll sideways: it has a shadow for the eye, and the keyboard reaches it.
  const BOXES = ".pst-scrollable-table-container, mjx-container";
  for (const box of all(BOXES)) {
    if (!scrolls(box) || box.scrollWidth <= box.clientWidth + 1) continue;
    if (!getComputedStyle(box).backgroundAttachment.includes("local")) say("it scrolls without a shadow", box);
    if (box.tabIndex !== 0) say("it scrolls beyond the keyboard", box);
  }

  // The part of the window in which an element can be seen: within every box around it that cuts what sticks out, but for
  // the content of one that scrolls.
  function visible(element) {
    let [left, right] = [0, root.clientWidth];
    for (let box = element.parentElement; box && box !== document.body; box = box.parentElement) {
      if (box.matches(BOXES) && scrolls(box)) return [-Infinity, Infinity];
      if (!clips(getComputedStyle(box))) continue;
      const edge = box.getBoundingClientRect();
      [left, right] = [Math.max(left, edge.left), Math.min(right, edge.right)];
    }
    return [left, right];
  }

  for (const element of all("div.math, mjx-container, div.highlight, div.highlight pre, pre, figure, img, iframe, .jupyter-widgets")) {
    if (element.closest("table, mjx-assistive-mml")) continue;
    const rect = element.getBoundingClientRect();
    const [left, right] = visible(element);
    // The invisible ends of a stretched bar count into the scrollWidth of a formula in the text; its box is what is drawn.
    const own = element.matches("mjx-container:not([display])") || (element.matches(BOXES) && scrolls(element)) ? 0 : element.scrollWidth - element.clientWidth;
    const out = Math.max(own, rect.right - right, left - rect.left);
    if (out > 1) say(`${Math.round(out)} px cut off`, element);
  }
  for (const table of all("table")) {
    let box = table;
    while (box.tagName !== "ARTICLE" && !scrolls(box)) box = box.parentElement;
    if (box.tagName === "ARTICLE" && table.scrollWidth > box.clientWidth + 1) say("a table without a box to scroll in", table);
  }
  for (const element of all("mjx-container, pre, pre span, code, td, th, figcaption, .page-figure text"))
    if (element.textContent.trim() && parseFloat(getComputedStyle(element).fontSize) < 11.99) say(`smaller than 12 px (${getComputedStyle(element).fontSize})`, element);
  for (const element of all("mjx-container, pre, img")) {
    const style = getComputedStyle(element);
    if (style.transform !== "none" || style.zoom !== "1") say("shrunk", element);
  }
  for (const element of all("figcaption, figcaption span, caption, caption span, .computed"))
    if (!element.closest("strong, b, h1, h2, h3, th, .stacked tr > :first-child") && +getComputedStyle(element).fontWeight > 400) say("bold", element);
  return found;
}
