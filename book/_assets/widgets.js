// What html-manager 1.0 needs to be told before it is loaded.

// It derives the address of its icon font from its own, which is that of a package on a content delivery network unless
// require.js, which reads this when it is loaded, knows where the package lies.
window.require = { paths: { "@jupyter-widgets/html-manager/dist": new URL("vendor", document.currentScript.src).href } };

// It asks for formulas in the words of MathJax 2, and the book has MathJax 4.
(window.MathJax ??= {}).startup = {
  ready() {
    MathJax.startup.defaultReady();
    MathJax.Hub = { Queue: ([, , element]) => MathJax.startup.promise.then(() => MathJax.typesetPromise([element])) };
  },
};
