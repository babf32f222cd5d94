// What is wider than its page: a table's rows are stacked, each cell with the name of its column; what still scrolls sideways
// can be reached by keyboard and says what it is (book.css draws shadows at its edges).
(() => {
  // The theme calls a colour mode that nobody has chosen yet invalid, in the console, and takes this one.
  document.documentElement.dataset.mode ||= "auto";

  const BOXES = { ".pst-scrollable-table-container": "table", "mjx-container[display]": "formula" };
  const widths = new WeakMap(); // of tables that have once been too wide
  const stack = (box) => {
    const names = [...box.querySelectorAll("thead tr:last-child th")];
    if (names.length < 3) return;
    if (!widths.has(box) && box.scrollWidth > box.clientWidth + 1) {
      widths.set(box, box.scrollWidth);
      for (const row of box.querySelectorAll("tbody tr")) {
        [...row.cells].slice(1).forEach((cell, k) => {
          if (!cell.textContent.trim()) return;
          const name = document.createElement("span");
          name.className = "column-name";
          name.append(...[...names[k + 1].childNodes].map((node) => node.cloneNode(true)));
          cell.prepend(name);
        });
      }
    }
    box.classList.toggle("stacked", widths.get(box) > box.clientWidth + 1);
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
  });
})();
