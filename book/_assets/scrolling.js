// A box that scrolls sideways can be reached by keyboard and says what it is; book.css draws shadows at its edges.
(() => {
  // The theme calls a colour mode that nobody has chosen yet invalid, in the console, and takes this one.
  document.documentElement.dataset.mode ||= "auto";

  const BOXES = { ".pst-scrollable-table-container": "table", "mjx-container[display]": "formula", ".wide-picture": "picture" };
  const watcher = new ResizeObserver((changed) => {
    for (const { target: box } of changed) {
      const what = Object.entries(BOXES).find(([selector]) => box.matches(selector))[1];
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
