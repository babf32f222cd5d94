// Settings for require.js, read when it is loaded: html-manager derives the address of its icon font from its own, which
// is that of a package on a content delivery network unless we say where it lies.
window.require = { paths: { "@jupyter-widgets/html-manager/dist": new URL("vendor", document.currentScript.src).href } };
