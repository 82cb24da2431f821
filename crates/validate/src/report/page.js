"use strict";
(() => {
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  for (const tools of all(".tools, .copy")) tools.hidden = false;

  // Sorting: numbers worst first, text from A. Absent values always come last.
  const table = document.querySelector("table.sortable");
  const body = table.tBodies[0];
  const key = (row, column) => {
    const cell = row.cells[column];
    if (cell.dataset.sort === undefined) return cell.textContent.trim();
    return cell.dataset.sort === "" ? null : Number(cell.dataset.sort);
  };
  const compare = (a, b) =>
    typeof a === "string" ? a.localeCompare(b, undefined, { numeric: true }) : (Number.isNaN(a) ? Infinity : a) - (Number.isNaN(b) ? Infinity : b) || 0;
  const heads = all("thead th", table);
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = head.textContent;
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      const rows = [...body.rows];
      const numeric = rows.some((row) => row.cells[column].dataset.sort !== undefined);
      const before = head.getAttribute("aria-sort");
      const descending = before ? before === "ascending" : numeric;
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", descending ? "descending" : "ascending");
      const keys = new Map(rows.map((row) => [row, key(row, column)]));
      rows.sort((a, b) => {
        const [x, y] = [keys.get(a), keys.get(b)];
        if (x === null || y === null) return (x === null) - (y === null);
        return descending ? compare(y, x) : compare(x, y);
      });
      body.append(...rows);
    });
  });
  heads[0].setAttribute("aria-sort", "descending");

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
