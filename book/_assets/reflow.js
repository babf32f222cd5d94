// What depends on the width of the window: formulas are broken into lines anew, and a box that scrolls can be reached by keyboard.
(() => {
  // The theme calls a colour mode that nobody has chosen yet invalid, in the console, and takes this one.
  document.documentElement.dataset.mode ||= "auto";

  function reachable() {
    for (const box of document.querySelectorAll(".pst-scrollable-table-container")) {
      if (box.scrollWidth > box.clientWidth) {
        box.setAttribute("tabindex", "0");
        box.setAttribute("role", "region");
        box.setAttribute("aria-label", "A table that scrolls sideways");
      } else {
        for (const name of ["tabindex", "role", "aria-label"]) box.removeAttribute(name);
      }
    }
  }

  const MEASURE = 110; // MathJax's step that measures the width (its STATE.METRICS); by itself it would keep the old one
  let width = window.innerWidth, timer;
  window.addEventListener("resize", () => {
    if (window.innerWidth === width) return;  // a telephone's address bar comes and goes
    width = window.innerWidth;
    clearTimeout(timer);
    timer = setTimeout(async () => {
      await window.MathJax?.startup?.document?.rerenderPromise(MEASURE);
      reachable();
    }, 200);
  });
  window.addEventListener("load", async () => {
    await window.MathJax?.startup?.promise;
    reachable();
  });
})();
