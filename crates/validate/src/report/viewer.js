// The pixels of a case: a slider between both images, other exposures, other error images, and the
// values of each pixel.
(() => {
  const all = (selector, root = document) => [...root.querySelectorAll(selector)];
  const drawing = JSON.parse(document.querySelector("main").dataset.drawing);

  // In the order of the codes in the packed pixels.
  const JUDGEMENTS = [
    "within tolerance",
    "UNEXPLAINED",
    "explained: an edge, a tiny shift of the sample makes the reference take our value",
    "explained: the reference takes our value with another spawn offset or traversal",
    "explained: within the range that is stored with the reference",
    "explained: ill-conditioned, a change of its last digits makes the reference take our value",
    "explained: ill-conditioned, a change of the last digits of its rays and of a vertex makes the reference take our value",
  ];
  const ERRORS = {
    relative: { label: "relative, turbo", caption: "relative error", ends: drawing.relative, colors: drawing.turbo },
    absolute: { label: "absolute, turbo", caption: "absolute error, in units of radiance", ends: drawing.absolute, colors: drawing.turbo },
    signed: { label: "signed, diverging", caption: "relative error with its sign: red where ours is brighter", ends: drawing.signed, colors: drawing.diverging },
    flip: { label: "FLIP, magma", caption: "FLIP: how visible the difference is", ends: [0, 1], colors: drawing.magma },
  };
  const NOT_FINITE = [255, 0, 255];

  const halves = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const [exponent, fraction] = [(bits >> 10) & 31, bits & 1023];
    const size = exponent === 0 ? fraction * 2 ** -24 : exponent === 31 ? (fraction ? NaN : Infinity) : (1024 + fraction) * 2 ** (exponent - 25);
    halves[bits] = bits & 32768 ? -size : size;
  }

  const inflate = async (text) => {
    const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  };

  // The planes that `pixels.rs` describes.
  const unpack = async (text, count) => {
    const bytes = await inflate(text);
    if (bytes.length !== 8 + 17 * count) throw new Error("the packed pixels do not have the size of the pictures");
    const mean = new DataView(bytes.buffer).getFloat64(0, true);
    const plane = (index) => bytes.subarray(8 + index * count, 8 + (index + 1) * count);
    const step = (index, pixel) => {
      const folded = plane(2 * index)[pixel] | (plane(2 * index + 1)[pixel] << 8);
      return (folded >> 1) ^ -(folded & 1);
    };
    const [ours, reference, relative] = [0, 1, 2].map(() => [0, 1, 2].map(() => new Float32Array(count)));
    for (let channel = 0; channel < 3; channel++) {
      const codes = plane(12 + channel);
      let bits = 0;
      for (let pixel = 0; pixel < count; pixel++) {
        bits = (bits + step(channel, pixel)) & 65535;
        const [a, b] = [halves[(bits + step(3 + channel, pixel)) & 65535], halves[bits]];
        [ours[channel][pixel], reference[channel][pixel]] = [a, b];
        const code = codes[pixel] & 127;
        let residual = code === 0 ? 0 : drawing.least * 10 ** ((code - 1) / drawing.codes);
        // Where half floats resolve the difference, they are more accurate.
        if (residual > 0.02) residual = Math.abs(a - b) / Math.max(Math.abs(b) + mean, 1.2e-38);
        relative[channel][pixel] = code === 127 ? NaN : codes[pixel] > 127 ? -residual : residual;
      }
    }
    const absolute = (channel, pixel) => relative[channel][pixel] * (Math.abs(reference[channel][pixel]) + mean);
    return { ours, reference, relative, absolute, flip: plane(15), judged: plane(16) };
  };

  const encoded = (linear) => (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
  const draw = (canvas, color) => {
    const context = canvas.getContext("2d");
    const image = context.createImageData(canvas.width, canvas.height);
    for (let pixel = 0; pixel < canvas.width * canvas.height; pixel++) {
      image.data.set(color(pixel), 4 * pixel);
      image.data[4 * pixel + 3] = 255;
    }
    context.putImageData(image, 0, 0);
  };
  const shown = (planes, exposure) => (pixel) => {
    const values = planes.map((plane) => plane[pixel]);
    if (!values.every(Number.isFinite)) return NOT_FINITE;
    return values.map((value) => Math.floor(255 * encoded(Math.min(1, Math.max(0, value * 2 ** exposure))) + 0.5));
  };
  const largest = (value, pixel) =>
    [0, 1, 2].map((channel) => value(channel, pixel)).reduce((worst, next) => (!(Math.abs(next) <= Math.abs(worst)) ? next : worst));
  const errorColor = (pixels, name) => (pixel) => {
    const { ends, colors } = ERRORS[name];
    const at = (part) => {
      const index = 3 * Math.round(255 * Math.min(1, Math.max(0, part)));
      return colors.slice(index, index + 3);
    };
    if (name === "flip") return at(pixels.flip[pixel] / 255);
    const value = largest(name === "absolute" ? pixels.absolute : (channel, at) => pixels.relative[channel][at], pixel);
    if (Number.isNaN(value)) return NOT_FINITE;
    const part = Math.log(Math.abs(value) / ends[0]) / Math.log(ends[1] / ends[0]);
    return at(name === "signed" ? 0.5 + 0.5 * Math.sign(value) * Math.max(0, part) : part);
  };

  const element = (name, properties = {}, ...children) => {
    const made = Object.assign(document.createElement(name), properties);
    made.append(...children);
    return made;
  };
  const number = (value) => (Number.isNaN(value) ? "NaN" : Number.isFinite(value) ? String(Number(value.toPrecision(4))) : value > 0 ? "∞" : "−∞");
  const short = (value) => (value === 0 ? "0" : value.toExponential(1));

  const open = (section, pictures) => {
    const [width, height] = [Number(pictures.dataset.width), Number(pictures.dataset.height)];
    const [oursFrame, referenceFrame, errorFrame] = all(".frame", pictures);
    const marks = all(".mark", pictures);
    const worst = all(".worst tbody tr", section);
    const name = section.querySelector("h3").textContent;
    const state = { pixels: null, exposure: 0, error: "relative", split: 100, pixel: null, kept: null };

    // The canvases cover the pictures, whose alternative texts remain for screen readers.
    const canvas = (frame) => {
      const made = element("canvas", { width, height });
      made.setAttribute("aria-hidden", "true");
      frame.querySelector("img").after(made);
      return made;
    };
    const [ours, beside, reference, error] = [oursFrame, oursFrame, referenceFrame, errorFrame].map(canvas);
    // Move it behind the other canvas of its frame.
    oursFrame.insertBefore(beside, ours.nextSibling);
    beside.className = "beside";

    const range = (label, className, min, max, step, value) =>
      element("input", { type: "range", className, min, max, step, value, ariaLabel: label });
    const slider = range("Part that shows ours; the rest shows the reference", "split", 0, 100, 1, 100);
    const exposure = range("Exposure in stops", "exposure", -10, 10, 0.5, 0);
    const stops = element("output", { className: "stops", textContent: "0" });
    const flip = element("button", { type: "button", className: "flip", textContent: "Flip" });
    flip.setAttribute("aria-pressed", "false");
    const choice = element("select", { className: "error-view" });
    choice.append(...Object.entries(ERRORS).map(([value, { label }]) => element("option", { value, textContent: label })));
    const readout = element("p", { className: "readout" });
    const tools = element(
      "div",
      { className: "viewer" },
      element("label", {}, "ours ", slider, " reference"),
      flip,
      element("label", {}, "Exposure ", exposure, stops),
      element("label", {}, "Error ", choice),
    );
    pictures.before(tools);
    pictures.after(readout);
    readout.setAttribute("role", "status");
    pictures.tabIndex = 0;
    pictures.setAttribute("role", "group");
    pictures.setAttribute("aria-label", `Pictures of ${name}. Arrow keys move from pixel to pixel, N and P go through the worst ones, F flips, + and − change the exposure, E changes the error image.`);

    const caption = oursFrame.parentElement.querySelector("figcaption");
    const errorCaption = errorFrame.parentElement.querySelector("figcaption");
    const scale = errorFrame.parentElement.querySelector(".scale");
    const legend = (name) => {
      const { ends, colors, caption } = ERRORS[name];
      errorCaption.textContent = caption;
      const texts = { flip: ["0", "0.5", "1"], signed: [`−${ends[1]}`, `±${ends[0]}`, `+${ends[1]}`] }[name];
      const middle = Math.sqrt(ends[0] * ends[1]).toExponential().replace("e-", "e-");
      const labels = texts ?? [`≤ ${ends[0].toExponential()}`, middle, `≥ ${ends[1].toExponential()}`];
      const stops = Array.from({ length: 33 }, (_, index) => {
        const at = 3 * Math.round((255 * index) / 32);
        return `rgb(${colors.slice(at, at + 3)})`;
      });
      scale.querySelector(".strip").style.background = `linear-gradient(to right, ${stops})`;
      all("span", scale).forEach((span, index) => (span.textContent = labels[index]));
      scale.setAttribute("aria-label", `Colour scale of the ${caption}: from ${labels[0]} over ${labels[1]} to ${labels[2]}`);
    };

    const drawPictures = () => {
      if (!state.pixels) return;
      draw(ours, shown(state.pixels.ours, state.exposure));
      for (const canvas of [beside, reference]) draw(canvas, shown(state.pixels.reference, state.exposure));
    };
    const drawError = () => {
      legend(state.error);
      if (state.pixels) draw(error, errorColor(state.pixels, state.error));
    };
    const setSplit = (split) => {
      state.split = split;
      slider.value = split;
      flip.setAttribute("aria-pressed", String(split === 0));
      beside.style.clipPath = `inset(0 0 0 ${split}%)`;
      beside.style.setProperty("--split", `${split}%`);
      oursFrame.style.setProperty("--split", `${split}%`);
      oursFrame.classList.toggle("is-split", split > 0 && split < 100);
      caption.textContent = split === 100 ? "ours" : split === 0 ? "reference, in place of ours" : "ours, then the reference";
    };
    const setExposure = (stops_) => {
      state.exposure = Math.min(10, Math.max(-10, stops_));
      exposure.value = state.exposure;
      stops.textContent = state.exposure > 0 ? `+${state.exposure}` : String(state.exposure);
      drawPictures();
    };
    const setError = (name) => {
      state.error = choice.value = name;
      drawError();
    };

    const words = (pixel) => {
      const [x, y] = pixel;
      const place = `pixel (${x}, ${y})`;
      const { pixels } = state;
      if (!pixels) return place;
      const index = y * width + x;
      const triple = (of, text) => [0, 1, 2].map((channel) => text(of(channel))).join(", ");
      const row = worst.find((row) => Number(row.dataset.x) === x && Number(row.dataset.y) === y);
      // The table has all digits and the exact explanation.
      const cell = (column) => row.cells[column].textContent.trim().replace(/\s+/g, " ");
      return [
        place,
        `ours ${row ? cell(2).replaceAll(" ", ", ") : triple((c) => pixels.ours[c][index], number)}`,
        `reference ${row ? cell(3).replaceAll(" ", ", ") : triple((c) => pixels.reference[c][index], number)}`,
        `difference ${triple((c) => pixels.absolute(c, index), short)}`,
        `relative ${triple((c) => pixels.relative[c][index], short)}`,
        row ? cell(4) : JUDGEMENTS[pixels.judged[index]],
      ].join(" · ");
    };
    const show = (pixel) => {
      state.pixel = pixel;
      for (const mark of marks) {
        mark.hidden = !pixel;
        if (pixel) {
          mark.style.left = `${(100 * (pixel[0] + 0.5)) / width}%`;
          mark.style.top = `${(100 * (pixel[1] + 0.5)) / height}%`;
        }
      }
      readout.textContent = pixel ? words(pixel) : "Point at a pixel, or focus a picture and use the arrow keys.";
    };
    const keep = (pixel) => {
      state.kept = pixel;
      for (const row of worst) {
        const here = pixel && Number(row.dataset.x) === pixel[0] && Number(row.dataset.y) === pixel[1];
        row.querySelector(".place button").setAttribute("aria-pressed", String(Boolean(here)));
      }
      show(pixel);
    };

    for (const frame of [oursFrame, referenceFrame, errorFrame]) {
      const at = (event) => {
        const box = frame.getBoundingClientRect();
        const place = (at, size, pixels) => Math.min(pixels - 1, Math.max(0, Math.floor((at / size) * pixels)));
        return [place(event.clientX - box.left, box.width, width), place(event.clientY - box.top, box.height, height)];
      };
      frame.addEventListener("pointermove", (event) => show(at(event)));
      frame.addEventListener("pointerleave", () => show(state.kept));
      frame.addEventListener("click", (event) => keep(at(event)));
    }
    const rowPixel = (row) => [Number(row.dataset.x), Number(row.dataset.y)];
    for (const row of worst) {
      const place = row.querySelector(".place");
      const button = element("button", { type: "button", title: "Show in the pictures", textContent: place.textContent });
      button.setAttribute("aria-pressed", "false");
      place.replaceChildren(button);
      row.addEventListener("pointerenter", () => show(rowPixel(row)));
      row.addEventListener("pointerleave", () => show(state.kept));
      button.addEventListener("click", () => {
        const pressed = button.getAttribute("aria-pressed") === "true";
        keep(pressed ? null : rowPixel(row));
        if (!pressed) pictures.scrollIntoView({ block: "nearest" });
      });
    }

    slider.addEventListener("input", () => setSplit(Number(slider.value)));
    flip.addEventListener("click", () => setSplit(state.split === 0 ? 100 : 0));
    exposure.addEventListener("input", () => setExposure(Number(exposure.value)));
    choice.addEventListener("change", () => setError(choice.value));
    const move = (right, down, event) => {
      const by = event.shiftKey ? 10 : 1;
      const [x, y] = state.kept ?? [Math.floor(width / 2), Math.floor(height / 2)];
      const within = (value, size) => Math.min(size - 1, Math.max(0, value));
      keep(state.kept ? [within(x + right * by, width), within(y + down * by, height)] : [x, y]);
    };
    const next = (step) => {
      if (worst.length === 0) return;
      const here = worst.findIndex((row) => state.kept && rowPixel(row).every((value, axis) => value === state.kept[axis]));
      const from = here < 0 ? (step > 0 ? -1 : 0) : here;
      keep(rowPixel(worst[(from + step + worst.length) % worst.length]));
    };
    const names = Object.keys(ERRORS);
    const KEYS = {
      ArrowLeft: (event) => move(-1, 0, event),
      ArrowRight: (event) => move(1, 0, event),
      ArrowUp: (event) => move(0, -1, event),
      ArrowDown: (event) => move(0, 1, event),
      f: () => flip.click(),
      n: () => next(1),
      p: () => next(-1),
      e: () => setError(names[(names.indexOf(state.error) + 1) % names.length]),
      "+": () => setExposure(state.exposure + 0.5),
      "=": () => setExposure(state.exposure + 0.5),
      "-": () => setExposure(state.exposure - 0.5),
      0: () => setExposure(0),
      Escape: () => keep(null),
    };
    pictures.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const key = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
      if (!key) return;
      event.preventDefault();
      key(event);
    });

    setSplit(100);
    show(null);
    unpack(pictures.dataset.pixels, width * height).then(
      (pixels) => {
        state.pixels = pixels;
        drawPictures();
        drawError();
        pictures.dataset.ready = "true";
        if (state.pixel) show(state.pixel);
      },
      (problem) => (readout.textContent = `The pixels cannot be read: ${problem.message}`),
    );
  };

  // Unpack only the cases that are open: a page has many.
  const watch = (section) => {
    const pictures = section.querySelector(".pictures[data-pixels]");
    if (!pictures) return;
    let opened = false;
    const look = () => {
      if (!section.open || opened) return;
      opened = true;
      open(section, pictures);
    };
    section.addEventListener("toggle", look);
    look();
  };
  all("details.case").forEach(watch);
  // A case whose pictures the page loads later.
  document.addEventListener("loaded", (event) => watch(event.target));
})();
