// The review of images: loads a pair when it is opened, and sends what is accepted.
(() => {
  "use strict";
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const message = document.getElementById("message");
  const heading = document.getElementById("left");

  const ask = async (path, body) => {
    const options = body === undefined ? {} : { method: "POST", body: JSON.stringify(body) };
    const answer = await fetch(path, options).catch(() => {
      throw new Error("The review has ended. This page can be closed.");
    });
    if (!answer.ok) throw new Error(await answer.text());
    return answer;
  };
  const attempt = async (work) => {
    message.textContent = "";
    try {
      await work();
    } catch (problem) {
      message.textContent = problem.message;
    }
  };

  for (const section of all("details.case")) {
    const pair = Number(section.dataset.pair);
    let loaded = false;
    const load = () =>
      attempt(async () => {
        if (!section.open || loaded) return;
        loaded = true;
        const place = section.querySelector(".details");
        place.textContent = "Loading the pictures.";
        try {
          place.innerHTML = await (await ask(`details?pair=${pair}`)).text();
        } catch (problem) {
          loaded = false;
          place.textContent = problem.message;
          return;
        }
        for (const figure of all("figure[data-width]", place)) figure.style.width = `${figure.dataset.width}px`;
        section.dispatchEvent(new Event("loaded", { bubbles: true }));
      });
    section.addEventListener("toggle", load);
    load();

    const [accept, undo] = [".accept", ".undo"].map((name) => section.querySelector(name));
    const decide = (path, button, other) => {
      button?.addEventListener("click", () =>
        attempt(async () => {
          button.disabled = true;
          try {
            const standing = await (await ask(path, { pair })).json();
            const badge = section.querySelector(".badge");
            badge.textContent = standing.word;
            badge.className = `badge ${standing.is_right ? "pass" : "fail"}`;
            section.classList.toggle("failed", !standing.is_right);
            heading.textContent = standing.left === 0 ? "Nothing is left to review" : `${standing.left} image${standing.left === 1 ? "" : "s"} to review`;
            heading.className = standing.left === 0 ? "pass" : "fail";
            [button.hidden, other.hidden] = [true, false];
            other.focus();
          } finally {
            button.disabled = false;
          }
        }),
      );
    };
    decide("accept", accept, undo);
    decide("undo", undo, accept);
  }

  document.getElementById("done").addEventListener("click", () =>
    attempt(async () => {
      await ask("done", {});
      all("button").forEach((button) => (button.disabled = true));
      heading.textContent = "The review has ended. This page can be closed.";
    }),
  );

  // The first image that differs is open from the start.
  const first = document.querySelector("details.case.failed");
  if (first) first.open = true;
})();
