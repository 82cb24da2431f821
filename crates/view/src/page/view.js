"use strict";
(() => {
  const at = (id) => document.getElementById(id);
  const NOT_FINITE = [255, 0, 255];
  const ERRORS = {
    relative: { plane: 0, caption: "relative error", colors: "turbo", ends: "relative" },
    absolute: { plane: 1, caption: "absolute error, in units of radiance", colors: "turbo", ends: "absolute" },
    signed: { plane: 0, caption: "relative error with its sign: red where ours is brighter", colors: "diverging", ends: "signed" },
    flip: { plane: 2, caption: "FLIP: how visible the difference is", colors: "magma", ends: null },
  };
  const HEATS = {
    steps: "inner nodes or cells that the ray through the centre of each pixel visits",
    tests: "elements that the ray through the centre of each pixel is tested with",
    rays: "rays traced for each pixel: camera, specular and shadow rays of all samples",
  };

  // What the server has told, and what is drawn.
  const state = { page: null, news: 0, number: 0, frame: null, facts: null, values: null, drawing: null, first: null };
  const wish = { look_at: null, accelerator: null, shown: "picture" };
  const compared = { key: null, source: null, pixels: null, width: 0, height: 0, errors: null, split: 100, error: "relative" };
  const picked = { pixel: null, report: null, step: null, number: 0 };
  let exposure = 0;

  const post = (path, value) => fetch(path, { method: "POST", body: JSON.stringify(value) });

  // Pixels.

  // For each half float the code on the screen.
  const codes = new Uint8Array(65536);
  const encoded = (linear) => (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
  // Half floats are in the order of their bits: from 0 on up to the value that is white, which is
  // all that has to be computed. Negative ones are black.
  const half = (bits) => {
    const [power, fraction] = [bits >> 10, bits & 1023];
    return power === 0 ? fraction * 2 ** -24 : (1024 + fraction) * 2 ** (power - 25);
  };
  const expose = () => {
    const scale = 2 ** exposure;
    codes.fill(255, 0, 32768);
    for (let bits = 0; bits < 31744; bits++) {
      const value = half(bits) * scale;
      if (value >= 1) break;
      codes[bits] = Math.floor(255 * encoded(value) + 0.5);
    }
  };

  const sized = (canvas, width, height) => {
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = canvas.getContext("2d");
    return [context, context.createImageData(width, height)];
  };
  const drawHalves = (canvas, values, width, height) => {
    const [context, image] = sized(canvas, width, height);
    const { data } = image;
    for (let pixel = 0; pixel < width * height; pixel++) {
      const [r, g, b] = [values[3 * pixel], values[3 * pixel + 1], values[3 * pixel + 2]];
      const to = 4 * pixel;
      if ((r & 31744) === 31744 || (g & 31744) === 31744 || (b & 31744) === 31744) data.set(NOT_FINITE, to);
      else {
        data[to] = codes[r];
        data[to + 1] = codes[g];
        data[to + 2] = codes[b];
      }
      data[to + 3] = 255;
    }
    context.putImageData(image, 0, 0);
  };
  const drawColors = (canvas, width, height, color) => {
    const [context, image] = sized(canvas, width, height);
    for (let pixel = 0; pixel < width * height; pixel++) {
      image.data.set(color(pixel), 4 * pixel);
      image.data[4 * pixel + 3] = 255;
    }
    context.putImageData(image, 0, 0);
  };
  const colorAt = (colors, part) => {
    const index = 3 * Math.round(255 * Math.min(1, Math.max(0, part)));
    return colors.slice(index, index + 3);
  };
  const legend = (scale, colors, labels) => {
    const stops = Array.from({ length: 33 }, (_, index) => `rgb(${colorAt(colors, index / 32)})`);
    scale.querySelector(".strip").style.background = `linear-gradient(to right, ${stops})`;
    scale.querySelectorAll("span").forEach((span, index) => (span.textContent = labels[index]));
  };

  const draw = () => {
    const { frame, values } = state;
    if (!frame) return;
    const { width, height } = frame;
    if (frame.shown === "picture") drawHalves(at("ours"), values, width, height);
    else if (state.drawing) {
      const most = values.reduce((most, value) => Math.max(most, value), 1);
      const { turbo } = state.drawing;
      drawColors(at("ours"), width, height, (pixel) => colorAt(turbo, values[pixel] / most));
      legend(at("heat-scale"), turbo, ["0", number(most / 2), number(most)]);
      const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
      at("caption").textContent = `${HEATS[frame.shown]}; mean ${number(mean)}, at most ${number(most)}`;
    }
    at("heat-scale").hidden = frame.shown === "picture";
  };
  const number = (value) => (value === null || value === undefined ? "–" : String(Number(Number(value).toPrecision(6))));
  const vector = (values) => values.map(number).join(", ");

  const size = () => {
    const [width, height] = state.frame.full;
    // Small pictures are enlarged by a whole number.
    const factor = Math.max(1, Math.floor(720 / width));
    for (const frame of document.querySelectorAll(".frame, .scale")) {
      frame.style.setProperty("--width", `${width * factor}px`);
      frame.style.setProperty("--ratio", `${width} / ${height}`);
    }
    at("overlay").setAttribute("viewBox", `0 0 ${width} ${height}`);
  };

  // The reference.

  const fits = () => compared.pixels && state.frame && state.frame.key === compared.key && state.frame.shown === "picture";
  const setSplit = (split) => {
    compared.split = split;
    const shown = fits() ? split : 100;
    at("split").value = shown;
    at("split").disabled = at("flip").disabled = !fits();
    at("flip").setAttribute("aria-pressed", String(shown === 0));
    at("beside").style.clipPath = `inset(0 0 0 ${shown}%)`;
    at("frame").style.setProperty("--split", `${shown}%`);
    at("frame").classList.toggle("is-split", shown > 0 && shown < 100);
    if (state.frame?.shown === "picture") at("caption").textContent = shown === 100 ? "ours" : shown === 0 ? "reference, in place of ours" : "ours, then the reference";
  };
  const drawError = () => {
    const shown = Boolean(fits() && compared.errors && state.drawing && state.frame.is_final);
    at("errors").hidden = at("error").disabled = !shown;
    if (!shown) return;
    const { plane, caption, colors, ends } = ERRORS[compared.error];
    const table = state.drawing[colors];
    const count = compared.width * compared.height;
    const values = compared.errors.subarray(plane * count, (plane + 1) * count);
    const [least, most] = ends ? state.drawing[ends] : [0, 1];
    drawColors(at("difference"), compared.width, compared.height, (pixel) => {
      const value = values[pixel];
      if (!Number.isFinite(value)) return NOT_FINITE;
      if (!ends) return colorAt(table, value);
      const part = Math.log(Math.abs(value) / least) / Math.log(most / least);
      return colorAt(table, colors === "diverging" ? 0.5 + 0.5 * Math.sign(value) * Math.max(0, part) : part);
    });
    at("errors").querySelector("figcaption").textContent = caption;
    const labels = { flip: ["0", "0.5", "1"], signed: [`−${most}`, `±${least}`, `+${most}`] }[compared.error];
    legend(at("errors").querySelector(".scale"), table, labels ?? [`≤ ${least.toExponential()}`, Math.sqrt(least * most).toExponential(), `≥ ${most.toExponential()}`]);
  };
  let fetching = false;
  const compare = async () => {
    const { reference } = state.facts;
    const texts = {
      none: "No reference of this scene is stored.",
      working: `${reference.message} …`,
      failed: `Mitsuba gave no picture: ${reference.message}`,
      ready: `Reference: ${reference.message}${state.frame && state.frame.key !== reference.key ? ", of another view or version" : ""}.`,
    };
    at("reference").textContent = texts[reference.state];
    at("live").disabled = reference.state === "working";
    if (reference.state === "ready" && !fetching && (compared.key !== reference.key || compared.source !== reference.message)) {
      fetching = true;
      const answer = await fetch(`reference?page=${state.page}`).finally(() => (fetching = false));
      if (answer.ok) {
        const bytes = await answer.arrayBuffer();
        [compared.width, compared.height] = new Uint32Array(bytes, 0, 2);
        compared.pixels = new Uint16Array(bytes, 8);
        [compared.key, compared.source, compared.errors] = [reference.key, reference.message, null];
        drawHalves(at("beside"), compared.pixels, compared.width, compared.height);
      }
    }
    if (fits() && state.frame.is_final && !compared.errors && !fetching) {
      fetching = true;
      const answer = await fetch(`errors?page=${state.page}`).finally(() => (fetching = false));
      if (answer.ok) compared.errors = new Float32Array(await answer.arrayBuffer());
    }
    setSplit(compared.split);
    drawError();
  };

  // News of the server.

  const times = [];
  const show = (facts) => {
    const { scene, problems, remark, tev } = facts;
    const list = problems.map(({ place, message, help }) => {
      const line = document.createElement("p");
      const where = document.createElement("span");
      where.className = "place";
      where.textContent = place ? `${place}: ` : "";
      line.append(where, message);
      if (help) {
        const advice = document.createElement("span");
        advice.className = "help";
        advice.textContent = help;
        line.append(advice);
      }
      return line;
    });
    at("problems").replaceChildren(...list);
    at("problems").hidden = list.length === 0;
    const warnings = (scene?.warnings ?? []).map(({ place, message }) => `${place}: ${message}`);
    const remarks = [remark, tev, ...warnings].filter(Boolean);
    at("remark").textContent = remarks.join(" · ");
    at("remark").hidden = remarks.length === 0;
    if (!scene) return;
    const names = scene.accelerators;
    if (at("accelerator").options.length !== names.length + 1) {
      const options = [["", "of the scene"], ...names.map((name) => [name, name])];
      at("accelerator").replaceChildren(...options.map(([value, textContent]) => Object.assign(document.createElement("option"), { value, textContent })));
      at("accelerator").value = wish.accelerator ?? "";
    }
    at("accelerator").title = `${scene.accelerator}: ${scene.reason}\n${Object.entries(scene.statistics).map(([name, value]) => `${name} ${number(value)}`).join("\n")}`;
  };
  const tell = () => {
    const { frame, facts } = state;
    const { scene } = facts;
    const rate = times.length > 1 ? ((times.length - 1) * 1000) / (times[times.length - 1] - times[0]) : 0;
    const parts = [
      `${frame.width} × ${frame.height}${frame.width === frame.full[0] ? "" : ` of ${frame.full[0]} × ${frame.full[1]}`}`,
      `${frame.samples} of ${scene.samples} samples`,
      frame.rays === null ? "" : `${frame.rays.toLocaleString("en")} rays`,
      `${number(frame.milliseconds.toFixed(1))} ms`,
      `${scene.accelerator}, built in ${number(scene.build_milliseconds.toFixed(1))} ms`,
      rate > 0 ? `${rate.toFixed(1)} updates/s` : "",
      frame.is_final ? "finished" : "",
    ];
    at("status").textContent = parts.filter(Boolean).join(" · ");
  };
  const receive = (bytes) => {
    const length = new DataView(bytes).getUint32(0, true);
    const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
    const { frame } = facts;
    state.facts = facts;
    state.news = facts.news;
    show(facts);
    if (frame) {
      const moved = state.frame?.key !== frame.key;
      state.number = facts.frame_number;
      state.frame = frame;
      state.values = frame.shown === "picture" ? new Uint16Array(bytes, 4 + length) : new Float32Array(bytes, 4 + length);
      if (moved) compared.errors = null;
      size();
      draw();
      const now = performance.now();
      times.push(now);
      while (times.length > 20 || now - times[0] > 2000) times.shift();
      state.first ??= now;
      tell();
      // For tests and measurements.
      Object.assign(document.body.dataset, { first: state.first, frame: state.number, key: frame.key, final: frame.is_final, width: frame.width, drawn: Date.now() });
      if (frame.is_final && picked.pixel && picked.key !== frame.key) pick(picked.pixel);
    }
    document.body.dataset.problems = facts.problems.length;
    compare();
  };
  const notice = (text, offer) => {
    at("notice").hidden = !text;
    at("notice").querySelector("span").textContent = text;
    at("take-over").hidden = !offer;
  };
  const follow = async () => {
    const { page } = state;
    while (state.page === page) {
      let answer;
      try {
        answer = await fetch(`frame?page=${page}&news=${state.news}&frame=${state.number}`);
        if (answer.status === 409) {
          state.page = null;
          return notice("Another page shows this view now.", true);
        }
        if (!answer.ok) throw new Error(await answer.text());
        receive(await answer.arrayBuffer());
        notice("", false);
      } catch (problem) {
        notice(`The view does not answer: ${problem.message}. Is the command still running?`, false);
        await new Promise((resolve) => setTimeout(resolve, 1000));
      }
    }
  };
  const open = async (takes_over) => {
    let answer;
    try {
      answer = await post("open", { takes_over });
      if (answer.status === 409) {
        // After a reload, the page before may not have closed yet.
        await new Promise((resolve) => setTimeout(resolve, 300));
        answer = await post("open", { takes_over });
      }
    } catch (problem) {
      return notice(`The view does not answer: ${problem.message}. Is the command still running?`, false);
    }
    if (answer.status === 409) return notice("Another page shows this view.", true);
    if (!answer.ok) return notice(await answer.text(), false);
    state.page = (await answer.json()).page;
    notice("", false);
    state.number = state.news = 0;
    follow();
    // Not needed for the first picture.
    state.drawing ??= await fetch("drawing.json").then((found) => found.json());
    draw();
    drawError();
  };
  addEventListener("pagehide", () => state.page && navigator.sendBeacon("close", JSON.stringify({ page: state.page })));
  // A page that comes back from the history has been closed.
  addEventListener("pageshow", (event) => event.persisted && open(false));

  // Wishes: one request at a time, and then the latest.

  let [sending, dirty] = [false, false];
  const send = async () => {
    if (sending) return void (dirty = true);
    sending = true;
    do {
      dirty = false;
      const answer = await post("wish", { page: state.page, ...wish }).catch(() => null);
      if (answer && !answer.ok && answer.status !== 409) notice(await answer.text(), false);
    } while (dirty);
    sending = false;
  };

  // The camera.

  const plus = (a, b, scale = 1) => a.map((value, axis) => value + scale * b[axis]);
  const scaled = (a, scale) => a.map((value) => value * scale);
  const dot = (a, b) => a.reduce((sum, value, axis) => sum + value * b[axis], 0);
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => scaled(a, 1 / Math.hypot(...a));
  const view = () => wish.look_at ?? state.facts?.scene?.look_at;
  const move = (change) => {
    const now = view();
    if (!now) return notice("This camera has no look_at, so it cannot be moved.", false);
    wish.look_at = change(now);
    send();
  };
  const orbit = (right, down) =>
    move(({ origin, target, up }) => {
      const away = plus(origin, target, -1);
      const [radius, pole] = [Math.hypot(...away), unit(up)];
      const height = dot(away, pole) / radius;
      const flat = plus(away, pole, -height * radius);
      const [along, aside] = [unit(flat), unit(cross(pole, flat))];
      // Never onto the pole, where up has no direction in the picture.
      const angle = Math.min(Math.PI - 0.02, Math.max(0.02, Math.acos(Math.min(1, Math.max(-1, height))) - down));
      const turned = plus(scaled(along, Math.cos(right)), aside, -Math.sin(right));
      const place = plus(scaled(turned, radius * Math.sin(angle)), pole, radius * Math.cos(angle));
      return { origin: plus(target, place), target, up };
    });
  const pan = (right, down) =>
    move(({ origin, target, up }) => {
      const away = plus(origin, target, -1);
      const side = unit(cross(up, away));
      const upright = unit(cross(away, side));
      const by = plus(scaled(side, -right), upright, down);
      const shift = scaled(by, Math.hypot(...away));
      return { origin: plus(origin, shift), target: plus(target, shift), up };
    });
  const dolly = (power) => move(({ origin, target, up }) => ({ origin: plus(target, plus(origin, target, -1), Math.exp(power)), target, up }));
  const reset = () => {
    wish.look_at = null;
    send();
  };

  // A pixel.

  const place = (event) => {
    const box = at("frame").getBoundingClientRect();
    const [width, height] = state.frame.full;
    const within = (part, pixels) => Math.min(pixels - 1, Math.max(0, Math.floor(part * pixels)));
    return [within((event.clientX - box.left) / box.width, width), within((event.clientY - box.top) / box.height, height)];
  };
  const pick = async (pixel) => {
    const key = state.frame.key;
    const asked = ++picked.number;
    const sample = picked.pixel && String(picked.pixel) === String(pixel) ? Number(at("sample").value) || 0 : 0;
    const answer = await post("pixel", { page: state.page, x: pixel[0], y: pixel[1], sample });
    if (asked !== picked.number) return;
    if (!answer.ok) return notice(await answer.text(), false);
    Object.assign(picked, { pixel, key, report: await answer.json(), step: null });
    at("sample").value = sample;
    at("sample").max = picked.report.samples - 1;
    report();
  };
  const unpick = () => {
    Object.assign(picked, { pixel: null, report: null, step: null });
    picked.number++;
    at("pixel").hidden = true;
    at("overlay").replaceChildren();
  };
  const rayName = ({ path }) => (path === "" ? "camera ray" : `ray ${path}`);
  const target = (ray) => (ray.limit ? "beyond the depth limit" : ray.shape < 0 ? "hits nothing" : `hits ${ray.name ?? `shape ${ray.shape}`}`);
  const words = (ray) => {
    const kind = ray.path === "" ? "The camera ray" : /T\d*$/.test(ray.path) ? "The transmitted ray" : "The reflected ray";
    const hit = ray.shape < 0 ? "" : ` at (${vector(ray.position)}), ${number(ray.t)} m away, where the normal is (${vector(ray.n_s)})`;
    const adds = ray.throughput.map((value, channel) => value * ray.local[channel]);
    return `${kind} ${ray.path} goes from (${vector(ray.origin)}) along (${vector(ray.direction)}) and ${target(ray)}${hit}. There, ${vector(ray.local)} arises; with the throughput ${vector(ray.throughput)} it adds ${vector(adds)} to the pixel.`;
  };
  const line = (ends, className) => {
    const made = document.createElementNS("http://www.w3.org/2000/svg", "line");
    const [[x1, y1], [x2, y2]] = ends;
    for (const [key, value] of Object.entries({ x1, y1, x2, y2, class: className })) made.setAttribute(key, value);
    return made;
  };
  const overlay = () => {
    const { report, step } = picked;
    const shapes = [];
    for (const className of ["outline", ""]) {
      const mark = document.createElementNS("http://www.w3.org/2000/svg", "rect");
      for (const [key, value] of Object.entries({ x: report.x, y: report.y, width: 1, height: 1, class: className })) mark.setAttribute(key, value);
      shapes.push(mark);
    }
    report.rays.slice(0, step === null ? undefined : step + 1).forEach((ray, index) => {
      const current = index === step ? " current" : "";
      // The camera ray is a point in its own picture.
      if (ray.line && ray.path !== "") {
        const kind = /T\d*$/.test(ray.path) ? "T" : "R";
        shapes.push(line(ray.line, `outline${current}`), line(ray.line, `${kind}${current}`));
      }
      if (ray.normal && (step === null ? false : current)) shapes.push(line(ray.normal, "normal"));
    });
    at("overlay").replaceChildren(...shapes);
  };
  const report = () => {
    const { report, step } = picked;
    at("pixel").hidden = false;
    at("pixel").querySelector("h2").textContent = `Pixel (${report.x}, ${report.y})`;
    const rows = [["value", vector(report.value)], ...report.layers.map(([name, value]) => [name, number(value)])];
    at("pixel").querySelector("tbody").replaceChildren(
      ...rows.map(([name, value]) => {
        const row = document.createElement("tr");
        row.append(Object.assign(document.createElement("th"), { textContent: name, scope: "row" }), Object.assign(document.createElement("td"), { textContent: value }));
        return row;
      }),
    );
    const items = report.rays.map((ray, index) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: `${rayName(ray)}: ${target(ray)}, throughput ${vector(ray.throughput)}, adds ${vector(ray.local)}` });
      button.style.paddingLeft = `${0.4 + Math.min(ray.depth, 12)}rem`;
      button.setAttribute("aria-current", String(index === step));
      button.classList.toggle("later", step !== null && index > step);
      button.addEventListener("click", () => toStep(index));
      const item = document.createElement("li");
      item.append(button);
      return item;
    });
    at("rays").replaceChildren(...items);
    const hidden = report.all_rays - report.rays.length;
    const undrawn = report.is_drawn ? "" : " This camera has no projection matrix, so the rays are not drawn.";
    at("ray").textContent = (step === null ? `${report.all_rays} rays of sample ${report.sample} of ${report.samples}${hidden > 0 ? `, of which ${hidden} are not listed` : ""}. Step goes along them.` : words(report.rays[step])) + undrawn;
    overlay();
    if (step !== null) items[step].scrollIntoView({ block: "nearest" });
  };
  const toStep = (step) => {
    picked.step = step;
    report();
  };
  const next = (by) => {
    if (!picked.report) return;
    const count = picked.report.rays.length;
    toStep(picked.step === null ? (by > 0 ? 0 : count - 1) : Math.min(count - 1, Math.max(0, picked.step + by)));
  };

  // Input.

  const frame = at("frame");
  let drag = null;
  frame.addEventListener("contextmenu", (event) => event.preventDefault());
  frame.addEventListener("pointerdown", (event) => {
    if (!state.frame) return;
    drag = { x: event.clientX, y: event.clientY, pans: event.button !== 0 || event.shiftKey, moved: false };
    frame.setPointerCapture(event.pointerId);
  });
  frame.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const [right, down] = [event.clientX - drag.x, event.clientY - drag.y];
    if (!drag.moved && Math.hypot(right, down) < 4) return;
    Object.assign(drag, { x: event.clientX, y: event.clientY, moved: true });
    frame.classList.add("moves");
    const height = frame.getBoundingClientRect().height;
    if (drag.pans) pan(right / height, down / height);
    else orbit((right / height) * Math.PI, (down / height) * Math.PI);
  });
  const release = (event) => {
    if (drag && !drag.moved && event.type === "pointerup" && event.button === 0) pick(place(event));
    drag = null;
    frame.classList.remove("moves");
  };
  frame.addEventListener("pointerup", release);
  frame.addEventListener("pointercancel", release);
  frame.addEventListener("wheel", (event) => {
    event.preventDefault();
    dolly(Math.sign(event.deltaY) * Math.min(1, Math.abs(event.deltaY) / 500));
  }, { passive: false });
  const arrow = (right, down) => (event) => (event.shiftKey ? pan(right * 0.05, down * 0.05) : orbit(right * 0.1, down * 0.1));
  const setExposure = (stops) => {
    exposure = Math.min(10, Math.max(-10, stops));
    at("exposure").value = exposure;
    at("stops").textContent = exposure > 0 ? `+${exposure}` : String(exposure);
    expose();
    draw();
    if (compared.pixels) drawHalves(at("beside"), compared.pixels, compared.width, compared.height);
  };
  const KEYS = {
    ArrowLeft: arrow(-1, 0),
    ArrowRight: arrow(1, 0),
    ArrowUp: arrow(0, -1),
    ArrowDown: arrow(0, 1),
    PageUp: () => dolly(-0.1),
    PageDown: () => dolly(0.1),
    Home: reset,
    Escape: unpick,
    f: () => at("flip").click(),
    n: () => next(1),
    p: () => next(-1),
    "+": () => setExposure(exposure + 0.5),
    "=": () => setExposure(exposure + 0.5),
    "-": () => setExposure(exposure - 0.5),
    0: () => setExposure(0),
  };
  frame.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const key = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
    if (!key) return;
    event.preventDefault();
    key(event);
  });
  at("exposure").addEventListener("input", () => setExposure(Number(at("exposure").value)));
  at("split").addEventListener("input", () => setSplit(Number(at("split").value)));
  at("flip").addEventListener("click", () => setSplit(compared.split === 0 ? 100 : 0));
  at("error").addEventListener("change", () => {
    compared.error = at("error").value;
    drawError();
  });
  at("shown").addEventListener("change", () => {
    wish.shown = at("shown").value;
    send();
  });
  at("accelerator").addEventListener("change", () => {
    wish.accelerator = at("accelerator").value || null;
    send();
  });
  at("reset").addEventListener("click", reset);
  at("live").addEventListener("click", () => post("live", { page: state.page }));
  at("take-over").addEventListener("click", () => open(true));
  at("sample").addEventListener("change", () => picked.pixel && pick(picked.pixel));
  at("next").addEventListener("click", () => next(1));
  at("back").addEventListener("click", () => next(-1));
  at("all").addEventListener("click", () => picked.report && toStep(null));

  // The first answer arrives while the codes are computed.
  open(false);
  expose();
})();
