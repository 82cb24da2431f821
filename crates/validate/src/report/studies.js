// Diagrams: shows the label of a dot and the command that measures it again, by pointer and keyboard.
(() => {
  for (const study of document.querySelectorAll(".study")) {
    const output = study.querySelector(".point output");
    const dots = [...study.querySelectorAll("svg circle")].filter((dot) => dot.querySelector("title"));
    const show = (dot) => {
      const [what, ...command] = dot.querySelector("title").textContent.split("\n");
      const code = document.createElement("code");
      code.textContent = command.join("\n");
      output.replaceChildren(`${what} `, ...(code.textContent ? [code] : []));
      for (const other of dots) other.classList.toggle("here", other === dot);
    };
    dots.forEach((dot, index) => {
      dot.setAttribute("role", "img");
      dot.setAttribute("aria-label", dot.querySelector("title").textContent);
      // One stop for Tab; arrow keys move to the other dots.
      dot.setAttribute("tabindex", index === 0 ? "0" : "-1");
      dot.addEventListener("pointerenter", () => show(dot));
      dot.addEventListener("focus", () => show(dot));
      dot.addEventListener("keydown", (event) => {
        const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
        if (!step) return;
        event.preventDefault();
        const to = dots[(index + step + dots.length) % dots.length];
        dot.setAttribute("tabindex", "-1");
        to.setAttribute("tabindex", "0");
        to.focus();
      });
    });
  }
})();
