// Pictures in the same place: the button, or a click on the picture, changes between the first two.
"use strict";
for (const views of document.querySelectorAll(".views")) {
  const [before, after] = views.querySelectorAll("input"),
    change = () => (before.checked ? after : before).click();
  views.querySelector(".flip").addEventListener("click", change);
  views.querySelector(".stack").addEventListener("click", change);
}
