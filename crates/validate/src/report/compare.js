// The page of compared images: the first one that differs is open from the start.
(() => {
  "use strict";
  for (const figure of document.querySelectorAll("figure[data-width]")) figure.style.width = `${figure.dataset.width}px`;
  const first = document.querySelector("details.case.failed") ?? document.querySelector("details.case:only-child");
  if (first) first.open = true;
})();
