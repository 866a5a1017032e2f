// The browser's half of a panel: sliders, and the pixels that the kernel sends. See panel.py for the other half.
//
// to the kernel    {kind: "ready" | "set" | "export", view, seq, values, settled, ratio, what}
// from the kernel  {kind: "picture", view, seq, verdict, values, size, order, ops} and two buffers (see draw/record.py), or a mime type and one buffer,
//                  {kind: "error", text, trace}, {kind: "said", text}
// One message at a time waits for its answer; meanwhile only the newest values are kept, so nothing lags behind a drag.

function make(tag, className, text) {
  const node = document.createElement(tag);
  if (className) node.className = className;
  if (text !== undefined) node.textContent = text;
  return node;
}

const clip = (x, low, high) => Math.min(Math.max(x, low), high);
const show = (x) => String(Number(Number(x).toPrecision(6))).replace("-", "−").replace("e+", "e");
const read = (text) => Number(text.trim().replace("−", "-").replace(",", "."));

// A slider runs over positions: the value itself, or its decimal logarithm. Values that can be set lie on a grid of round numbers.
function scale(control) {
  const log = control.kind === "log";
  const position = (value) => (log ? Math.log10(value) : value);
  const round = (at) => {
    if (!log) return Number((Math.round(at / control.step) * control.step).toPrecision(12));
    return Number((10 ** (Math.round(at / control.step) * control.step)).toPrecision(control.step < 1 ? 2 : 1));
  };
  const value = (at) => clip(round(at), control.low, control.high);
  return { position, value, low: position(control.low), high: position(control.high), step: control.step };
}

function sliderRow(control, changed) {
  const { position, value, low, high, step } = scale(control);
  const row = make("div", "labkit-control");
  const range = make("input", "labkit-range");
  const field = make("input", "labkit-value");
  let current = control.value;
  Object.assign(range, { type: "range", min: low, max: high, step: "any" });
  Object.assign(field, { type: "text", spellcheck: false, inputMode: "decimal" });
  range.setAttribute("aria-label", `${control.name}${control.index} ${control.meaning}`);
  field.setAttribute("aria-label", `value of ${control.name}${control.index}`);

  const put = (x) => {
    current = x;
    range.value = position(x);
    range.style.setProperty("--part", `${100 * clip((position(x) - low) / (high - low), 0, 1)}%`);
    range.setAttribute("aria-valuetext", `${show(x)} ${control.unit}`);
    if (document.activeElement !== field) field.value = show(x);
  };
  const move = (x, settled) => {
    if (x === current && !settled) return;
    put(x);
    changed(control.key, x, settled);
  };
  range.addEventListener("input", () => move(value(range.valueAsNumber), false));
  range.addEventListener("change", () => move(current, true));
  range.addEventListener("dblclick", () => move(control.value, true));
  // Lab keeps the arrow keys from a native slider, so they are handled here.
  const keys = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10, Home: -1e9, End: 1e9 };
  range.addEventListener("keydown", (event) => {
    if (!(event.key in keys) || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    move(value(clip(position(current) + keys[event.key] * step, low, high)), false);
  });
  range.addEventListener("keyup", (event) => event.key in keys && move(current, true));
  field.addEventListener("change", () => {
    const x = read(field.value);
    if (field.value.trim() && Number.isFinite(x) && (control.kind !== "log" || x > 0)) move(x, true);
    field.value = show(current);
  });
  field.addEventListener("keydown", (event) => {
    if (event.key === "Escape") field.value = show(current);
    if (event.key === "Escape" || event.key === "Enter") range.focus();
  });
  const head = make("span", "labkit-head");
  head.append(name(control), make("span", "labkit-meaning", control.meaning), field, make("span", "labkit-unit", control.unit));
  row.append(head, range);
  return { row, put };
}

function selectRow(control, changed) {
  const row = make("label", "labkit-control");
  const head = make("span", "labkit-head");
  const select = make("select", "labkit-select");
  select.append(...control.options.map((text) => make("option", "", text)));
  select.value = control.value;
  select.addEventListener("change", () => changed(control.key, select.value, true));
  head.append(name(control), make("span", "labkit-meaning", control.meaning));
  row.append(head, select);
  return { row, put: (x) => (select.value = x) };
}

function name(control) {
  const node = make("span", control.name.length === 1 ? "labkit-name labkit-letter" : "labkit-name", control.name);
  if (control.index) node.append(make("sub", "", control.index));
  return node;
}

// ---- the picture: what Matplotlib drew, stroke by stroke
function unpack(parts, buffers) {
  const [floats, bytes] = buffers.map((view) => view.buffer.slice(view.byteOffset, view.byteOffset + view.byteLength));
  const [points, pixels] = [new Float32Array(floats), new Uint8Array(bytes)];
  let [p, b] = [0, 0];
  const paths = ({ n, apart }) => {
    const made = [new Path2D()];
    let [last, down] = [made[0], false];
    for (const end = p + 2 * n; p < end; p += 2) {
      const x = points[p];
      if (x === x) {
        if (down) last.lineTo(x, points[p + 1]);
        else last.moveTo(x, points[p + 1]);
        down = true;
      } else {
        if (points[p + 1]) last.closePath();
        else if (apart) made.push((last = new Path2D()));
        down = false;
      }
    }
    return made;
  };
  const bitmap = ([, , w, h], op) => {
    const image = new ImageData(w, h);
    if (op.rgba) image.data.set(pixels.subarray(b, (b += 4 * w * h)));
    else {
      const ink = parseInt(op.fill.slice(5, 7) + op.fill.slice(3, 5) + op.fill.slice(1, 3), 16);
      const words = new Uint32Array(image.data.buffer);
      for (let k = 0; k < w * h; k++) words[k] = ink | (pixels[b++] << 24);
    }
    const made = Object.assign(make("canvas"), { width: w, height: h });
    made.getContext("2d").putImageData(image, 0, 0);
    return made;
  };
  for (const op of Object.values(parts).flat()) {
    if (op.image) op.bitmap = bitmap(op.image, op);
    else op.paths = paths(op);
    if (op.at) op.places = points.subarray(p, (p += 2 * op.at));
  }
}

function draw(context, op, draft) {
  context.save();
  if (op.clip) {
    context.beginPath();
    context.rect(...op.clip);
    context.clip();
  }
  if (op.bitmap) context.drawImage(op.bitmap, op.image[0], op.image[1]);
  else {
    const width = draft && !op.dash ? Math.min(op.width, Math.max(1, op.width - 0.5)) : op.width; // a line of one pixel is painted six times as fast
    Object.assign(context, { fillStyle: op.fill, strokeStyle: op.stroke, lineWidth: width, lineCap: op.cap, lineJoin: width < 3 ? "miter" : op.join, miterLimit: 4 });
    if (op.dash) [context.lineDashOffset] = op.dash;
    if (op.dash) context.setLineDash(op.dash.slice(1));
    const places = op.places || [0, 0];
    for (let k = 0; k < places.length; k += 2) {
      context.setTransform(1, 0, 0, 1, places[k], places[k + 1]);
      for (const path of op.paths) {
        if (op.fill) context.fill(path);
        if (op.stroke) context.stroke(path);
      }
    }
  }
  context.restore();
}

function render({ model, el }) {
  const spec = model.get("spec");
  const me = Math.random().toString(36).slice(2);
  const values = Object.fromEntries(spec.controls.map((control) => [control.key, control.value]));
  const errands = []; // exports, one after the other
  let [seq, waiting, next, patience] = [0, false, null, []];
  let [order, parts, base, newest, frame, slow] = [null, {}, null, null, 0, false]; // the picture: its parts in drawing order, the first of them as pixels

  el.classList.add("labkit-panel");
  const canvas = make("canvas", "labkit-picture");
  Object.assign(canvas, { width: 2 * spec.width, height: 2 * spec.height });
  canvas.style.width = `${spec.width}px`;
  canvas.style.aspectRatio = `${spec.width} / ${spec.height}`;
  canvas.setAttribute("role", "img");
  const verdict = make("div", "labkit-verdict", spec.verdict);
  verdict.setAttribute("role", "status");
  el.append(canvas, verdict);

  // ---- messages
  const post = () => {
    const message = waiting ? null : next || errands.shift();
    if (!message) return;
    if (message === next) next = null;
    [waiting, seq] = [true, seq + 1];
    model.send({ ...message, view: me, seq, ratio: window.devicePixelRatio || 1 });
    patience = [[400, "the kernel is busy"], [8000, "no answer: the kernel is busy, or it was restarted; then run the cell again"]].map(([time, text]) =>
      setTimeout(() => (verdict.dataset.late = `  … ${text}`), time));
  };
  const ask = (message) => {
    if (message.kind === "export") errands.push(message);
    else next = message; // only the newest
    post();
  };
  const changed = (key, value, settled) => {
    values[key] = value;
    ask({ kind: "set", values, settled });
    arrange();
  };
  const answered = async (message, buffers) => {
    const mine = message.view === me;
    if (mine) {
      waiting = false;
      patience.forEach(clearTimeout);
      delete verdict.dataset.late;
      post(); // the next one is on its way before this one is painted
    }
    if (message.kind === "said") note.textContent = message.text;
    if (message.kind === "error" && mine) complain(message);
    if (message.kind !== "picture") return;
    if (!mine || !waiting) sync(message.values);
    if (message.mime) await bitmap(buffers[0], message);
    else if (message.order || order) {
      unpack(message.ops, buffers);
      if (message.order) [order, parts, base] = [message.order, {}, null];
      Object.assign(parts, message.ops);
      newest = message;
      frame ||= requestAnimationFrame(paint); // only the newest picture of each animation frame is painted
    }
    verdict.classList.remove("labkit-error");
    verdict.textContent = message.verdict;
    verdict.style.minHeight = `${verdict.offsetHeight}px`; // a shorter sentence does not move the sliders
  };
  const layer = (target, ids, [width, height], draft) => {
    if (target.width !== width || target.height !== height) Object.assign(target, { width, height });
    const context = target.getContext("2d", { alpha: false });
    if (base) context.drawImage(base, 0, 0);
    for (const id of ids) for (const op of parts[id]) draw(context, op, draft);
    return context;
  };
  const paint = () => {
    frame = 0;
    if (!base) {
      base = layer(make("canvas"), order.slice(0, 1), newest.size).canvas; // the still background, once
      const begin = performance.now();
      layer(make("canvas"), order.slice(1), newest.size).getImageData(0, 0, 1, 1); // waits until all is painted
      slow = performance.now() - begin > 12;
    }
    layer(canvas, order.slice(1), newest.size, slow && newest.settled === false);
    if (newest.view === me) canvas.dataset.seq = newest.seq;
  };
  const bitmap = async (bytes, message) => {
    newest = message;
    const picture = await createImageBitmap(new Blob([bytes], { type: message.mime }));
    if (newest !== message) return; // decoding is asynchronous: a newer one was faster
    const [width, height] = message.size;
    order = null;
    Object.assign(canvas, { width, height });
    canvas.getContext("2d").drawImage(picture, 0, 0, width, height);
    canvas.dataset.seq = message.seq;
  };
  const complain = (message) => {
    verdict.classList.add("labkit-error");
    verdict.replaceChildren(make("div", "", message.text));
    if (!message.trace) return;
    const more = make("details");
    const trace = make("pre", "", message.trace);
    more.append(make("summary", "", "where it happened"), trace);
    more.addEventListener("toggle", () => (trace.scrollTop = trace.scrollHeight)); // the last lines tell most
    verdict.append(more);
  };

  // ---- controls
  const rows = {};
  const grids = {};
  for (const control of spec.controls) {
    if (!(control.group in grids)) {
      grids[control.group] = make("div", "labkit-grid");
      const group = make("fieldset", "labkit-group");
      group.append(make("legend", "", control.group), grids[control.group]);
      el.append(group);
    }
    rows[control.key] = (control.kind === "select" ? selectRow : sliderRow)(control, changed);
    rows[control.key].row.title = [control.meaning, control.unit && `in ${control.unit}`].filter(Boolean).join(", ");
    grids[control.group].append(rows[control.key].row);
  }
  const sync = (newest) => {
    Object.assign(values, newest);
    for (const [key, row] of Object.entries(rows)) row.put(values[key]);
    arrange();
  };
  const arrange = () => {
    for (const { key, only } of spec.controls) {
      if (only) rows[key].row.hidden = (only === "fixed") !== spec.fixed.includes(values.method);
    }
  };
  const bar = make("div", "labkit-bar");
  const note = make("span", "labkit-note");
  const button = (text, title, action) => {
    const node = make("button", "labkit-button", text);
    Object.assign(node, { type: "button", title });
    node.addEventListener("click", action);
    bar.append(node);
  };
  button("Reset", "all values back to those of the notebook", () => {
    sync(Object.fromEntries(spec.controls.map((control) => [control.key, control.value])));
    ask({ kind: "set", values, settled: true });
  });
  button("Save CSV", "the run on show as a table, beside the notebook", () => ask({ kind: "export", what: "csv" }));
  button("Save NPZ", "the run on show for NumPy, beside the notebook", () => ask({ kind: "export", what: "npz" }));
  button("Save PNG", "the picture, beside the notebook", () => ask({ kind: "export", what: "png" }));
  bar.append(note);
  note.setAttribute("role", "status");
  el.append(bar);
  // Lab's own keys (arrows, a, b, d d …) rest while the panel has the focus, but Ctrl-S still saves and Shift-Enter still runs.
  const keys = (event) => {
    const lab = event.ctrlKey || event.metaKey || (event.shiftKey && event.key === "Enter");
    if (el.contains(event.target)) event.target.toggleAttribute("data-lm-suppress-shortcuts", !lab);
  };
  window.addEventListener("keydown", keys, true);

  sync({});
  model.on("msg:custom", answered);
  bitmap(model.get("first"), { mime: "image/png", size: [canvas.width, canvas.height], seq: 0 });
  ask({ kind: "ready" });
  return () => {
    model.off("msg:custom", answered);
    window.removeEventListener("keydown", keys, true);
    cancelAnimationFrame(frame);
  };
}

export default { render };
