// On the site no kernel answers: controls that would do nothing are disabled, and a sentence says where they work.
(() => {
  const SENTENCE = "These controls need a running kernel, so they are disabled on the site. They work in JupyterLab: make lab opens it.";
  const CONTROLS = ".noUi-target, .widget-readout, button, input, select, textarea";

  function disable(control) {
    if (control.matches(".noUi-target")) {
      control.setAttribute("disabled", ""); // noUiSlider asks for this attribute before it listens to mouse or keys
      const name = control.closest(".jupyter-widgets")?.querySelector(".widget-label")?.textContent;
      for (const handle of control.querySelectorAll(".noUi-handle")) {
        handle.setAttribute("aria-disabled", "true");
        handle.setAttribute("tabindex", "-1");
        if (name) handle.setAttribute("aria-label", name);
      }
    } else if (control.matches(".widget-readout")) {
      control.setAttribute("contenteditable", "false");
      control.setAttribute("tabindex", "-1");
    } else {
      control.disabled = true;
    }
  }

  function visit() {
    for (const box of document.querySelectorAll(".jupyter-widgets")) {
      const controls = box.querySelectorAll(CONTROLS);
      controls.forEach(disable);
      const outermost = !box.parentElement.closest(".jupyter-widgets");
      if (controls.length && outermost && !box.previousElementSibling?.matches(".no-kernel")) {
        const note = Object.assign(document.createElement("p"), { className: "no-kernel", textContent: SENTENCE });
        note.setAttribute("role", "note");
        box.before(note);
      }
    }
  }

  // Widgets appear one by one, long after the page. Attributes are not observed, so what visit() sets does not call it again.
  document.addEventListener("DOMContentLoaded", () => {
    new MutationObserver(visit).observe(document.body, { childList: true, subtree: true });
    visit();
  });
})();
