// What is wider than its page: a table's rows are stacked, each cell with the name of its column; what still scrolls sideways
// can be reached by keyboard and says what it is (book.css draws shadows at its edges).
(() => {
  // The theme calls a colour mode that nobody has chosen yet invalid, in the console, and takes this one.
  document.documentElement.dataset.mode ||= "auto";

  // In a narrow window equations that stand side by side stand below each other: before MathJax, which is deferred, sees them.
  const rows = () => document.querySelectorAll("div.math").forEach(({ lastChild: text }) => {
    text.data = text.data.replaceAll("\\qquad", "\\\\");
  });
  if (innerWidth < 600) document.addEventListener("readystatechange", rows, { once: true });

  const BOXES = { ".pst-scrollable-table-container": "table", "mjx-container[display]": "formula" };
  const TALL = 0.35; // of the table's width: a row that is higher has columns that are too narrow
  const widths = new WeakMap(); // below which a table is stacked
  const squeezed = (box) =>
    box.scrollWidth > box.clientWidth + 1 ||
    Math.max(...Array.from(box.querySelectorAll("tbody tr"), (row) => row.offsetHeight)) > TALL * box.clientWidth;
  const label = (box) => {
    const names = [...box.querySelectorAll("thead tr:last-child th")];
    for (const row of box.querySelectorAll("tbody tr")) {
      [...row.cells].forEach((cell, k) => {
        if (!cell.textContent.trim() || !names[k].textContent.trim()) return;
        const name = document.createElement("span");
        name.className = "column-name";
        name.append(...Array.from(names[k].childNodes, (node) => node.cloneNode(true)));
        cell.prepend(name);
      });
    }
  };
  const stack = (box) => {
    if (!box.clientWidth || box.querySelectorAll("thead tr:last-child th").length < 2) return;
    if (!box.classList.contains("stacked") && squeezed(box)) {
      if (!widths.has(box)) label(box);
      widths.set(box, Math.max(box.scrollWidth, box.clientWidth + 1));
    }
    box.classList.toggle("stacked", box.clientWidth < (widths.get(box) ?? 0));
  };
  const watcher = new ResizeObserver((changed) => {
    for (const { target: box } of changed) {
      const what = Object.entries(BOXES).find(([selector]) => box.matches(selector))[1];
      if (what === "table") stack(box);
      const scrolls = box.scrollWidth > box.clientWidth + 1;
      const marks = { tabindex: "0", role: "region", "aria-label": `A ${what} that scrolls sideways` };
      for (const [name, value] of Object.entries(marks)) scrolls ? box.setAttribute(name, value) : box.removeAttribute(name);
    }
  });
  window.addEventListener("load", async () => {
    await window.MathJax?.startup?.promise;
    for (const box of document.querySelectorAll(Object.keys(BOXES))) watcher.observe(box);
    // Formulas above the place that a link leads to have changed their heights.
    if (location.hash) document.getElementById(decodeURIComponent(location.hash.slice(1)))?.scrollIntoView();
  });
})();
