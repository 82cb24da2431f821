"use strict";
(() => {
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  for (const tools of all(".tools, .copy")) tools.hidden = false;

  const body = document.querySelector("table.sortable").tBodies[0];

  // Filtering, of the table and of the sections alike.
  const text = document.getElementById("filter");
  const failures = document.getElementById("failures");
  const plugin = document.getElementById("plugin");
  const shown = document.getElementById("shown");
  const filter = () => {
    const words = text.value.toLowerCase().split(/\s+/).filter(Boolean);
    let count = 0;
    for (const row of body.rows) {
      const uses = !plugin?.value || row.dataset.plugins.split(" ").includes(plugin.value);
      const fits = uses && words.every((word) => row.dataset.words.includes(word));
      row.hidden = !fits || (failures.checked && !row.classList.contains("failed"));
      // There is no section if each scene has its own page.
      const section = document.getElementById(row.dataset.case);
      if (section) section.hidden = row.hidden;
      count += !row.hidden;
    }
    shown.textContent = `${count} of ${body.rows.length} shown`;
  };
  text.addEventListener("input", filter);
  failures.addEventListener("change", filter);
  plugin?.addEventListener("change", filter);
  filter();

  // A link to a case opens it.
  const follow = () => {
    const target = location.hash && document.getElementById(location.hash.slice(1));
    if (target instanceof HTMLDetailsElement) {
      target.open = true;
      target.scrollIntoView();
    }
  };
  addEventListener("hashchange", follow);
  for (const link of all('.summary a[href^="#"]')) link.addEventListener("click", () => setTimeout(follow));
  follow();
  for (const button of all("[data-open]"))
    button.addEventListener("click", () => {
      for (const section of all("details.case")) section.open = button.dataset.open === "all";
    });

  for (const button of all(".copy"))
    button.addEventListener("click", async () => {
      const code = button.parentElement.querySelector("code");
      try {
        await navigator.clipboard.writeText(code.textContent);
        button.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(code);
        button.textContent = "Selected";
      }
      setTimeout(() => (button.textContent = "Copy"), 1500);
    });
})();
