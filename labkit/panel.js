// The browser's half of a panel: sliders, hands, keys and pixels. The other half is panel.py.
//
// to the kernel    {kind, view, seq, ratio, scale, settled, …}: ready; set values; drag handle x y;
//   limits axes limits; start axes x y; clear; cursor t, or axes x y; hold on; large on; undo;
//   export what. One at a time waits for its answer; of those that may wait only the newest is kept.
// from the kernel  {kind: "picture", view, seq, verdict, stopped, values, axes, grips, t, span,
//   reading, begun, undo, hold, large, code, size, order, ops} and two buffers (draw/record.py), or
//   a mime type and one buffer; {kind: "error", text, trace}; {kind: "said", text}, or with name,
//   mime and one buffer: a file.

function make(tag, className, ...children) {
  const node = document.createElement(tag);
  if (className) node.className = className;
  node.append(...children.filter((child) => child !== undefined));
  return node;
}

const attributes = (node, list) => {
  for (const [name, text] of Object.entries(list)) node.setAttribute(name, text);
  return node;
};
const clip = (x, low, high) => Math.min(Math.max(x, low), high);
const show = (x) => { // six digits; 1e20, not a one with twenty zeros
  const near = Number(Number(x).toPrecision(6));
  const text = Math.abs(near) >= 1e7 ? near.toExponential() : String(near);
  return text.replaceAll("-", "−").replace("e+", "e");
};
const read = (text) => (
  text.trim() ? Number(text.trim().replaceAll("−", "-").replace(",", ".")) : NaN
);

// A slider runs over positions: the value itself, or its decimal logarithm. The values that it can
// set lie on a grid that begins at `base`: Control.nearest of controls.py says the same.
function scale({ kind, base, step, low, high }) {
  const log = kind === "log";
  const position = (value) => (log ? Math.log10(value) : value);
  const nearest = (at) => {
    const on = base + Math.floor((at - base) / step + 0.5) * step;
    const value = Number(log ? (10 ** on).toPrecision(step < 1 ? 2 : 1) : on.toPrecision(12));
    return clip(value, low, high);
  };
  return { position, nearest };
}

function sliderRow(control, changed, refused) {
  const { low, high, unit, step } = control;
  const { position, nearest } = scale(control);
  const [least, most] = [position(low), position(high)];
  const title = control.name + control.index;
  const range = attributes(make("input", "labkit-range"), {
    type: "range", min: least, max: most, step: "any", "aria-label": `${title} ${control.meaning}`,
  });
  const field = attributes(make("input", "labkit-value"), {
    type: "text", spellcheck: false, inputmode: "decimal", "aria-label": `value of ${title}`,
  });
  let [current, touch] = [control.value, null];

  const write = (x) => { // the field is as wide as its number: all digits of it can be read
    field.value = show(x);
    field.style.setProperty("--digits", field.value.length);
  };
  const put = (x) => {
    current = x;
    range.value = position(x);
    const part = 100 * clip((position(x) - least) / (most - least), 0, 1);
    range.style.setProperty("--part", `${part}%`);
    range.setAttribute("aria-valuetext", `${show(x)} ${unit}`);
    if (document.activeElement === field && !field.ariaInvalid) return; // someone writes in it
    write(x);
    field.removeAttribute("aria-invalid");
  };
  const move = (x, settled) => {
    if (x === current && !settled) return;
    put(x);
    changed(control.key, x, settled);
  };
  // A finger moves a slider sideways only: up and down it scrolls the page, and a touch is no move.
  range.addEventListener("pointerdown", (event) => {
    touch = event.pointerType === "touch" ? { x: event.clientX, value: current } : null;
  });
  range.addEventListener("pointermove", (event) => {
    if (touch && Math.abs(event.clientX - touch.x) > 8) touch.moves = true;
  });
  range.addEventListener("pointercancel", () => {
    if (touch) move(touch.value, true);
    touch = null;
  });
  const still = () => touch && !touch.moves;
  range.addEventListener("input", () => {
    if (still()) put(current);
    else move(nearest(range.valueAsNumber), false);
  });
  range.addEventListener("change", () => (still() ? put(current) : move(current, true)));
  range.addEventListener("dblclick", () => move(control.value, true));
  // Lab keeps the arrow keys from a native slider, so they are handled here.
  const keys = {
    ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1,
    PageUp: 10, PageDown: -10, Home: -1e9, End: 1e9,
  };
  range.addEventListener("keydown", (event) => {
    if (!(event.key in keys) || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    move(nearest(clip(position(current) + keys[event.key] * step, least, most)), false);
  });
  range.addEventListener("keyup", (event) => event.key in keys && move(current, true));

  const typed = () => {
    if (!field.ariaInvalid && field.value === show(current)) return true;
    let x = read(field.value);
    x = [low, high].find((end) => show(end) === show(x)) ?? x; // an end as it is shown
    if (x >= low && x <= high) {
      field.removeAttribute("aria-invalid");
      move(x, true);
      write(current);
      return true;
    }
    const wrong = Number.isNaN(x) ? "is no number" : "is outside";
    field.setAttribute("aria-invalid", true);
    refused(`${title}: “${field.value}” ${wrong}; type one from ${show(low)} to ${show(high)}` +
      `${unit && ` ${unit}`}. The picture still shows ${show(current)}.`);
    return false;
  };
  field.addEventListener("change", typed);
  field.addEventListener("keydown", ({ key }) => {
    if (key === "Escape") {
      if (field.ariaInvalid) refused("");
      field.setAttribute("aria-invalid", true); // what stands there is given up
      put(current);
    }
    if (key === "Escape" || (key === "Enter" && typed())) range.focus();
  });
  const head = make("span", "labkit-head", ...words(control), field, make("span", "labkit-unit", unit));
  return { row: make("div", "labkit-control", head, range), put };
}

function selectRow(control, changed) {
  const options = control.options.map((text) => make("option", "", text));
  const select = make("select", "labkit-select", ...options);
  select.addEventListener("change", () => changed(control.key, select.value, true));
  const head = make("span", "labkit-head", ...words(control));
  return { row: make("label", "labkit-control", head, select), put: (x) => (select.value = x) };
}

function words({ name, index, meaning }) {
  const node = make("span", name.length === 1 ? "labkit-name labkit-letter" : "labkit-name", name);
  if (index) node.append(make("sub", "", index));
  return [node, make("span", "labkit-meaning", meaning)];
}

// ---- the picture: what Matplotlib drew, stroke by stroke
// Ops learn their paths and bitmaps once: those of a recording come again as they are.
function unpack(parts, buffers) {
  const ops = [...new Set(Object.values(parts).flat())].filter((op) => !op.paths && !op.sheet);
  const [floats, bytes] = buffers.map(({ buffer, byteOffset, byteLength }) =>
    buffer.slice(byteOffset, byteOffset + byteLength));
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
  // All bitmaps of a message lie in one canvas, one below the other: making one takes long.
  const images = ops.filter((op) => op.image);
  const wide = Math.max(0, ...images.map(({ image }) => image[2]));
  const tall = images.reduce((sum, { image }) => sum + image[3], 0);
  const data = tall && new ImageData(wide, tall);
  const words = tall && new Uint32Array(data.data.buffer);
  const sheet = attributes(make("canvas"), { width: wide, height: tall });
  let y = 0;
  for (const op of images) {
    const [, , w, h] = op.image;
    const ink = op.rgba || parseInt(op.fill.slice(1, 7).match(/../g).reverse().join(""), 16);
    for (let row = 0; row < h; row++) {
      const at = (y + row) * wide;
      if (op.rgba) data.data.set(pixels.subarray(b, (b += 4 * w)), 4 * at);
      else for (let k = at; k < at + w; k++) words[k] = ink | (pixels[b++] << 24);
    }
    Object.assign(op, { sheet, y });
    y += h;
  }
  if (tall) sheet.getContext("2d").putImageData(data, 0, 0);
  for (const op of ops) {
    if (!op.image) op.paths = paths(op);
    if (op.at) op.places = points.subarray(p, (p += 2 * op.at));
  }
}

function draw(context, op, draft, zoom) {
  context.save();
  context.scale(zoom, zoom);
  if (op.clip) {
    context.beginPath();
    context.rect(...op.clip);
    context.clip();
  }
  const [left, top, w, h] = op.image || [];
  context.imageSmoothingQuality = "high";
  if (op.sheet) context.drawImage(op.sheet, 0, op.y, w, h, left, top, w, h);
  else {
    // A line of one pixel is painted six times as fast.
    const thin = draft && !op.dash;
    const lineWidth = thin ? Math.min(op.width, Math.max(1, op.width - 0.5)) : op.width;
    const lineJoin = draft && lineWidth < 3 ? "miter" : op.join;
    const look = { fillStyle: op.fill, strokeStyle: op.stroke, lineCap: op.cap, miterLimit: 4 };
    Object.assign(context, look, { lineWidth, lineJoin });
    if (op.dash) [context.lineDashOffset] = op.dash;
    if (op.dash) context.setLineDash(op.dash.slice(1));
    const places = op.places || [0, 0];
    for (let k = 0; k < places.length; k += 2) {
      context.setTransform(zoom, 0, 0, zoom, zoom * places[k], zoom * places[k + 1]);
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
  const kernel = model.widget_manager?.kernel;
  const me = Math.random().toString(36).slice(2);
  const values = Object.fromEntries(spec.controls.map((control) => [control.key, control.value]));
  const queue = new Map(); // messages that wait, by what they replace
  const [rows, wanted, pointers] = [{}, {}, new Map()]; // wanted: limits asked for, by axes
  let [seq, sent, flying, patience] = [0, 0, null, []]; // flying: what waits for its answer
  let [order, parts, base, newest, frame, slow] = [null, {}, null, null, 0, false];
  let above = []; // parts from the first moving one on; those below it are kept as pixels
  let info = { axes: [], grips: [], span: [0, 1], t: null, verdict: spec.verdict };
  let [shot, press, pinned, playing, chosen, current, rest] = [null, null, false, 0, -1, 0, 0];
  let marked = ""; // what the buttons say
  let wide = spec.width; // of the canvas on the page; an observer measures it: asking costs a layout

  const canvas = make("canvas", "labkit-picture");
  const ratio = () => {
    const dpr = window.devicePixelRatio || 1;
    const exact = (Math.round(wide * dpr) + 0.25) / spec.width; // whole pixels: nothing is blurred
    return Math.abs(wide - spec.width) < 1 ? dpr : exact;
  };
  Object.assign(canvas, { width: spec.width * ratio(), height: spec.height * ratio() });
  const [ring, time] = [spec.handles.length > 0, spec.moves];
  const help = spec.recorded || [
    spec.planes && "click in a plane: trajectory from there", ring && "drag a ring",
    spec.clicks && "click in a map: its values",
    time && "over a time plot: cursor; click: it stays; a finger sideways moves it",
    "drag: shifts the axes · wheel or two fingers: zoom · double click: back · + − 0: zoom",
    spec.axes > 1 && "a: next axes", "Alt-arrows: shift · Ctrl-Z: undo",
    (time || ring) && `arrow keys: ${[time && "cursor", ring && "ring"].filter(Boolean).join(" or ")}`,
    time && ring && "Enter: which", time && "Space: play", spec.planes && ring && "n: start at the ring",
    spec.planes && "Delete: clear",
  ].filter(Boolean).join(" · ");
  attributes(canvas, {
    role: "application", tabindex: 0, "aria-label": spec.alt,
    "aria-roledescription": "live picture", "aria-description": help,
  });
  const live = (className, ...children) =>
    attributes(make("div", className, ...children), { role: "status" });
  const reading = live("labkit-reading", "\u00a0");
  const [opinion, stopped] = [make("span", "", spec.verdict), make("strong", "", spec.stopped)];
  const trouble = make("div", "labkit-trouble");
  const verdict = live("labkit-verdict", stopped, opinion, trouble);
  const stage = make("div", "labkit-stage", canvas, reading, verdict);
  const [side, foot] = [make("div", "labkit-side"), make("div", "labkit-foot")];
  const room = make("div", "labkit-room", stage, side, foot);
  room.style.setProperty("--w", `${Math.floor(spec.width)}px`);
  room.style.setProperty("--shape", spec.width / spec.height);
  el.classList.add("labkit-panel");
  el.append(room);

  // ---- messages
  const post = () => {
    if (flying || !queue.size) return;
    const [key, message] = queue.entries().next().value;
    queue.delete(key);
    flying = message;
    sent = ratio();
    const more = { view: me, seq: ++seq, ratio: sent, scale: wide / spec.width };
    try {
      model.send({ ...message, ...more });
    } catch {
      return lose(); // the kernel was restarted, or is dead
    }
    patience = [400, 900, 8000].map((after) => setTimeout(wait, after, after));
  };
  const wait = (after) => {
    const cut = kernel && kernel.connectionStatus !== "connected";
    let text = cut ? "no connection to the kernel" : "the kernel is busy";
    if (after > 400) stop();
    if (after > 900) text = `no answer: ${text}; if it does not end, ${again}`;
    verdict.dataset.late = `… ${text}`;
  };
  const again = spec.download ? "reload this page" : "run the notebook again: Run ▸ Run All Cells";
  const enable = (on) => {
    el.classList.toggle("labkit-lost", !on);
    for (const node of el.querySelectorAll("input, select, button")) node.disabled = !on;
    marked = "";
  };
  const calm = () => { // the kernel answers, or the message that was sent last is taken back
    patience.forEach(clearTimeout);
    delete verdict.dataset.late;
  };
  const lose = () => {
    [flying, pinned] = [null, false];
    queue.clear();
    calm();
    stop();
    enable(false);
    complain({ text: `This panel has no kernel any more: ${again}.` });
  };
  const ask = (kind, more = {}, key = kind) => {
    if (el.classList.contains("labkit-lost") && kind !== "ready") return;
    queue.set(key, { kind, ...more });
    post();
  };
  const set = (changes, settled, more = {}) => {
    const before = queue.get("set")?.values;
    ask("set", { values: { ...before, ...changes }, settled, ...more });
  };
  const tidy = () => { // a value that was refused goes as soon as another one is taken
    for (const node of el.querySelectorAll("[aria-invalid]")) rows[node.key].put(values[node.key]);
  };
  const changed = (key, value, settled) => {
    values[key] = value;
    tidy();
    arrange();
    set({ [key]: value }, settled);
  };
  const answered = async (message, buffers) => {
    const mine = message.view === me;
    if (mine) {
      flying = null;
      calm();
      if (el.classList.contains("labkit-lost")) enable(true);
      post(); // the next one is on its way before this one is painted
    }
    if (message.kind === "said" && mine) {
      if (message.name) save(new Blob(buffers, { type: message.mime }), message.name);
      tell(message.text);
    }
    if (message.kind === "error" && mine) complain(message);
    if (message.kind !== "picture") return;
    sync(message.values, { ...flying?.values, ...queue.get("set")?.values });
    info = message;
    if (message.mime) await bitmap(buffers[0], message);
    else if (message.order || order) {
      unpack(message.ops, buffers);
      if (message.order) [order, parts, base] = [message.order, {}, null];
      Object.assign(parts, message.ops);
      newest = message;
      frame ||= requestAnimationFrame(paint); // only the newest picture of each animation frame
    }
    judge();
    mark();
  };
  const say = (node, text) => node.textContent !== text && (node.textContent = text);
  const judge = () => {
    el.classList.remove("labkit-old");
    verdict.classList.toggle("labkit-error", Boolean(info.stopped));
    if (trouble.firstChild) trouble.replaceChildren();
    say(reading, info.reading || "\u00a0");
    say(stopped, info.stopped || "");
    say(opinion, info.verdict);
  };
  const complain = ({ text, trace }) => {
    el.classList.add("labkit-old"); // what is shown is not what was asked for
    verdict.classList.add("labkit-error");
    for (const node of [stopped, opinion]) say(node, "");
    for (const key of Object.keys(wanted)) delete wanted[key];
    trouble.replaceChildren(make("div", "", text));
    if (!trace) return;
    const [lines, summary] = [make("pre", "", trace), make("summary", "", "where it happened")];
    const more = make("details", "", summary, lines);
    lines.tabIndex = 0;
    more.addEventListener("toggle", () => (lines.scrollTop = lines.scrollHeight)); // the end tells most
    trouble.append(more);
  };

  // ---- the picture
  const layer = (target, ids, { size: [width, height], zoom = 1 }, draft) => {
    if (target.width !== width || target.height !== height) Object.assign(target, { width, height });
    const context = target.getContext("2d", { alpha: false });
    if (base) context.drawImage(base, 0, 0);
    for (const id of ids) for (const op of parts[id]) draw(context, op, draft, zoom);
    return context;
  };
  const paint = () => {
    frame = 0;
    const { settled } = newest;
    if (!base) {
      const first = order.findIndex((id) => id[0] === "m");
      above = first < 0 ? [] : order.slice(first);
      const below = order.slice(0, order.length - above.length);
      base = layer(make("canvas"), below, newest).canvas; // the still background, once
      if (settled !== false) {
        const begin = performance.now();
        layer(make("canvas"), above, newest).getImageData(0, 0, 1, 1); // waits until all is painted
        slow = performance.now() - begin > 12;
      }
    }
    layer(canvas, above, newest, slow && settled === false);
    shot = null;
    for (const k of Object.keys(wanted)) {
      if (queue.has(`limits${k}`) || flying?.axes === Number(k)) preview(k);
      else delete wanted[k];
    }
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

  // ---- zoom: limits [x0, y0, x1, y1] are linear in pixels; until the kernel's picture comes, the
  // one there is is stretched
  const preview = (k) => {
    const { box: [left, top, width, height], limits: [x0, y0, x1, y1] } = info.axes[k];
    const [a, b, c, d] = wanted[k];
    shot ||= Object.assign(make("canvas"), { width: canvas.width, height: canvas.height });
    if (!shot.full) shot.getContext("2d").drawImage(canvas, 0, 0);
    shot.full = true;
    const context = canvas.getContext("2d");
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    context.fillStyle = "#fff";
    context.fillRect(left, top, width, height);
    const [sx, sy] = [(x1 - x0) / (c - a), (y1 - y0) / (d - b)];
    const [px, py] = [left + ((x0 - a) / (c - a)) * width, top + ((d - y1) / (d - b)) * height];
    context.setTransform(sx, 0, 0, sy, px - left * sx, py - top * sy);
    context.drawImage(shot, left, top, width, height, left, top, width, height);
    context.restore();
  };
  const relimit = (k, move) => {
    if (!info.axes[k]) return;
    wanted[k] = move(wanted[k] || info.axes[k].limits);
    preview(k);
    const more = { axes: k, limits: wanted[k] };
    ask("limits", { ...more, settled: false }, `limits${k}`);
    clearTimeout(rest);
    rest = setTimeout(() => ask("limits", more, `limits${k}`), 350); // then labels find their places
  };
  const zoom = (k, factor, x, y) => relimit(k, (old) => {
    const [left, top, width, height] = info.axes[k].box;
    const px = old[0] + ((x - left) / width) * (old[2] - old[0]);
    const py = old[3] - ((y - top) / height) * (old[3] - old[1]);
    return old.map((value, i) => (i % 2 ? py : px) + (value - (i % 2 ? py : px)) * factor);
  });
  const shift = (k, dx, dy) => relimit(k, (old) => {
    const [, , width, height] = info.axes[k].box;
    const [right, up] = [(dx / width) * (old[2] - old[0]), (-dy / height) * (old[3] - old[1])];
    return old.map((value, i) => value - (i % 2 ? up : right));
  });
  const home = (k) => {
    clearTimeout(rest);
    delete wanted[k];
    if (!info.axes[k].home) ask("limits", { axes: k, limits: null }, `limits${k}`);
  };
  const homes = () => info.axes.forEach((_, k) => home(k));

  // ---- mouse and fingers
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    const scale = canvas.width / box.width;
    return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale, scale];
  };
  const over = (x, y) => info.axes.findIndex(({ box: [left, top, width, height] }) =>
    x >= left && x <= left + width && y >= top && y <= top + height);
  const grip = (x, y, reach) => {
    const away = info.grips.map(([a, b]) => Math.hypot(a - x, b - y));
    const nearest = away.indexOf(Math.min(...away));
    return away[nearest] <= reach ? nearest : -1;
  };
  const at = (k) => info.axes[k]?.kind;
  const listen = (name, action, options) => canvas.addEventListener(name, action, options);
  listen("pointerdown", (event) => {
    const [x, y, scale] = place(event);
    const [touch, axes] = [event.pointerType === "touch", over(x, y)];
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [x, y]);
    press = { x, y, touch, axes, grip: grip(x, y, (touch ? 24 : 12) * scale), act: "" };
    press.before = wanted[axes] || info.axes[axes]?.limits;
    if (pointers.size > 1) press.act = "zoom";
    if (press.grip >= 0) chosen = press.grip;
    if (axes >= 0) current = axes;
  });
  // A finger that sets out up or down scrolls the page; sideways it moves the cursor or the axes.
  const intent = (dx, dy) => {
    if (press.grip >= 0) return "drag";
    if (press.axes < 0 || (press.touch && Math.abs(dy) > Math.abs(dx))) return "none";
    return press.touch && at(press.axes) === "time" ? "scrub" : "shift";
  };
  listen("pointermove", (event) => {
    const [x, y, scale] = place(event);
    if (!press || !pointers.has(event.pointerId)) {
      const k = over(x, y);
      canvas.style.cursor = grip(x, y, 12 * scale) >= 0 ? "grab" : k < 0 ? "" : "crosshair";
      if (at(k) === "time" && !pinned && !playing) ask("cursor", { axes: k, x, y });
      return;
    }
    const [dx, dy] = [x - press.x, y - press.y];
    if (!press.act && Math.hypot(dx, dy) <= (press.touch ? 10 : 4) * scale) return;
    press.act ||= intent(dx, dy);
    const [oldX, oldY] = pointers.get(event.pointerId);
    const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
    pointers.set(event.pointerId, [x, y]);
    if (press.act === "drag") ask("drag", { handle: press.grip, x, y, settled: false });
    if (press.act === "shift") shift(press.axes, x - oldX, y - oldY);
    if (press.act === "scrub") pin(press.axes, x, y);
    if (press.act !== "zoom" || !other || press.axes < 0) return;
    const far = Math.hypot(oldX - other[0], oldY - other[1]);
    const factor = far / Math.hypot(x - other[0], y - other[1]);
    zoom(press.axes, factor, (x + other[0]) / 2, (y + other[1]) / 2);
  });
  const lifted = (event) => {
    const [x, y] = place(event);
    pointers.delete(event.pointerId);
    if (!press || pointers.size) return;
    if (event.type === "pointercancel") { // the page scrolls: nothing has happened
      if (press.act === "shift") relimit(press.axes, () => press.before);
      press = null;
    } else if (press.act === "drag") ask("drag", { handle: press.grip, x, y, settled: true });
  };
  listen("pointerup", lifted);
  listen("pointercancel", lifted);
  listen("touchmove", (event) => { // no scrolling under a ring or two fingers
    const own = event.touches.length > 1 || press?.grip >= 0;
    if (own && event.cancelable) event.preventDefault();
  }, { passive: false });
  listen("click", (event) => {
    if (!press || press.act || event.detail > 1) return;
    const { axes, x, y } = press;
    const handle = info.axes[axes]?.click ?? -1;
    if (handle >= 0) return ask("drag", { handle, x, y, settled: true });
    if (at(axes) === "plane" && press.grip < 0) ask("start", { axes, x, y }, Symbol("start"));
    if (at(axes) === "time") pin(axes, x, y);
  });
  listen("dblclick", (event) => {
    const k = over(...place(event));
    if (k < 0) return;
    const started = at(k) === "plane" && press?.grip < 0;
    if (started) ask("clear", { last: 1 }, Symbol("clear")); // its first click was none
    home(k);
  });
  listen("pointerleave", () => {
    if (!pinned && !playing && info.t !== null) ask("cursor", { t: null });
  });
  listen("wheel", (event) => {
    const [x, y] = place(event);
    const k = over(x, y);
    if (k < 0 || document.activeElement !== canvas) return; // the page still scrolls
    event.preventDefault();
    zoom(k, 1.0015 ** clip(event.deltaY * (event.deltaMode ? 30 : 1), -300, 300), x, y);
  }, { passive: false });

  // ---- time
  const pin = (axes, x, y) => {
    stop();
    pinned = true;
    ask("cursor", { axes, x, y });
  };
  const cursor = (t) => {
    if (!spec.moves) return;
    pinned = true;
    info.t = clip(t, ...info.span);
    ask("cursor", { t: info.t });
  };
  const play = () => {
    const [first, last] = info.span;
    const from = info.t === null || info.t >= last ? first : info.t;
    const clock = spec.time === "s" && last - first >= 2 && last - first <= 20; // as fast as it
    const speed = clock ? 1 : (last - first) / 10;
    let begin;
    const step = (now) => {
      begin ??= now;
      const t = Math.min(from + ((now - begin) / 1000) * speed, last);
      cursor(t);
      if (t < last && playing) playing = requestAnimationFrame(step);
      else stop();
    };
    playing = requestAnimationFrame(step);
    buttons.play.textContent = "❚❚ Pause";
    reading.setAttribute("aria-live", "off"); // nobody can listen that fast
  };
  const stop = () => {
    cancelAnimationFrame(playing);
    playing = 0;
    reading.removeAttribute("aria-live");
    if (buttons.play) buttons.play.textContent = "▶ Play";
  };
  const toggle = () => spec.moves && (playing ? stop() : play());
  const free = () => {
    pinned = false;
    stop();
  };

  // ---- keys
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  listen("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || !info.axes.length) return;
    const { box: [left, top, width, height] } = info.axes[current];
    const closer = (factor) => zoom(current, factor, left + width / 2, top + height / 2);
    const [held, big] = [info.grips[chosen], event.shiftKey ? 0.1 : 0.01];
    const act = {
      " ": toggle, Delete: () => ask("clear"), Backspace: () => ask("clear"), 0: homes,
      "+": () => closer(0.8), "=": () => closer(0.8), "-": () => closer(1.25),
      Escape: () => {
        free();
        ask("cursor", { t: null });
      },
      a: () => {
        current = (current + 1) % info.axes.length;
        tell(`zoom: axes ${current + 1} of ${info.axes.length}`);
      },
      Enter: () => {
        chosen = chosen + 2 > info.grips.length ? -1 : chosen + 1;
        if (ring) tell(`arrow keys move: ${chosen < 0 ? "the time cursor" : spec.handles[chosen]}`);
      },
      n: () => {
        const [x, y] = held || info.grips[0] || [];
        if (at(over(x, y)) === "plane") ask("start", { axes: over(x, y), x, y }, Symbol("start"));
      },
    }[event.key];
    const arrow = arrows[event.key];
    if (!act && !arrow) return;
    event.preventDefault();
    if (act) return act();
    const under = held && !event.altKey ? over(...held) : -1; // a ring moves by its own axes' width
    const far = big * (under >= 0 ? info.axes[under].box[2] : width);
    if (event.altKey) shift(current, -5 * far * arrow[0], -5 * far * arrow[1]);
    else if (held) {
      const [x, y] = [(held[0] += far * arrow[0]), (held[1] += far * arrow[1])];
      ask("drag", { handle: chosen, x, y, settled: false });
    } else if (arrow[0]) {
      cursor((info.t ?? info.span[0]) + arrow[0] * big * (info.span[1] - info.span[0]));
    }
  });
  listen("keyup", (event) => {
    if (event.key in arrows && info.grips[chosen] && !event.altKey) set({}, true); // the hand rests
  });
  // Lab's own keys (arrows, a, b, d d, Ctrl-Z) rest while the panel has the focus, but Ctrl-S still
  // saves and Shift-Enter still runs.
  const keys = (event) => {
    if (!el.contains(event.target)) return;
    const command = event.ctrlKey || event.metaKey;
    const undo = command && !event.shiftKey && event.key === "z";
    const lab = !undo && (command || (event.shiftKey && event.key === "Enter"));
    event.target.toggleAttribute("data-lm-suppress-shortcuts", !lab);
    if (!undo || event.target.matches(".labkit-value")) return; // a field has an undo of its own
    event.preventDefault();
    ask("undo", {}, Symbol("undo"));
  };

  // ---- controls
  const refused = (text) => (text ? complain({ text }) : judge());
  for (const group of new Set(spec.controls.map((control) => control.group))) {
    const grid = make("div", "labkit-grid");
    for (const control of spec.controls.filter((one) => one.group === group)) {
      const row = control.kind === "select" ? selectRow : sliderRow;
      const made = (rows[control.key] = row(control, changed, refused));
      for (const node of made.row.querySelectorAll("input")) node.key = control.key;
      made.put(control.value);
      const unit = control.unit && `in ${control.unit}`;
      made.row.title = [control.meaning, unit].filter(Boolean).join(", ");
      grid.append(made.row);
    }
    side.append(make("fieldset", "labkit-group", make("legend", "", group), grid));
  }
  if (!side.firstChild) room.classList.add("labkit-bare");
  const sync = (told, held = {}) => {
    const other = (key) => key in told && !(key in held) && told[key] !== values[key];
    const news = Object.keys(rows).filter(other);
    for (const key of news) rows[key].put((values[key] = told[key]));
    if (news.length) [tidy(), arrange()];
  };
  const arrange = () => {
    const fixed = spec.fixed.includes(values.method);
    for (const { key, only } of spec.controls) {
      if (only) rows[key].row.hidden = (only === "fixed") !== fixed;
    }
  };
  const [bar, note, buttons] = [make("div", "labkit-bar"), live("labkit-note labkit-said"), {}];
  const tell = (text) => {
    say(note, text);
    note.title = text;
  };
  const button = (key, text, title, action, where = bar) => {
    if (spec.recorded && where === bar && !["play", "reset", "full"].includes(key)) return;
    const node = Object.assign(make("button", "labkit-button", text), { type: "button", title });
    node.addEventListener("click", action);
    where.append((buttons[key] = node));
    return node;
  };
  const lasting = (kind) => () => ask(kind, { on: !info[kind] });
  const mark = () => { // what the buttons say of the panel's state, whoever has changed it
    const home = info.axes.every((one) => one.home);
    const state = [!info.hold, !info.large, !info.undo, !info.begun, home].join();
    if (state === marked) return;
    marked = state;
    for (const kind of ["hold", "large"]) {
      buttons[kind]?.setAttribute("aria-pressed", Boolean(info[kind]));
    }
    const idle = { undo: !info.undo, clear: !info.begun, home };
    for (const [key, off] of Object.entries(idle)) if (buttons[key]) buttons[key].disabled = off;
    el.classList.toggle("labkit-large", Boolean(info.large));
  };
  const reset = () => {
    free();
    homes();
    set({}, true, { reset: true, home: true });
  };
  const save = (blob, name) => {
    const link = Object.assign(make("a"), { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  };
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(info.code);
      tell(`copied: ${info.code}`);
    } catch { // not allowed here: the text, ready for Ctrl-C
      const text = attributes(make("input", "labkit-code"), { readonly: "", "aria-label": "code" });
      text.value = info.code;
      note.replaceChildren(text);
      text.select();
    }
  };
  const fill = () => (document.fullscreenElement ? document.exitFullscreen() : el.requestFullscreen());
  if (Object.keys(spec.presets).length) {
    const row = make("div", "labkit-bar labkit-presets", make("span", "labkit-note", "try"));
    for (const [text, changes] of Object.entries(spec.presets)) {
      const go = () => set(changes, true, { reset: true });
      button(text, text, "sets the sliders to values of the notebook", go, row);
    }
    verdict.after(row);
  }
  if (time) button("play", "▶ Play", "lets the cursor run through the time (Space)", toggle);
  const back = () => ask("undo", {}, Symbol("undo"));
  button("undo", "Undo", "the settings before the last change (Ctrl-Z)", back);
  button("reset", "Reset", "values, axes and cursor as at first", reset);
  button("home", "Home", "the axes as they were before the zoom (0)", homes);
  const ghost = "keeps the run on show as a grey ghost, to compare others with it";
  if (time) button("hold", "Hold", ghost, lasting("hold"));
  const away = "takes away the trajectories that clicks have started (Delete)";
  if (spec.planes) button("clear", "Clear", away, () => ask("clear"));
  button("large", "Classroom", "large letters, thick lines, axes that stay", lasting("large"));
  if (document.fullscreenEnabled) button("full", "Full screen", "only this panel (Esc: back)", fill);
  button("code", "Code", "copies these settings as a line of Python", copy);
  const where = spec.download ? "into the browser's downloads" : "beside the notebook";
  for (const what of ["csv", "npz", "png"]) {
    const go = () => ask("export", { what }, Symbol(what));
    button(what, `Save ${what.toUpperCase()}`, where, go);
  }
  const hints = spec.recorded ? make("div", "labkit-note", help)
    : make("details", "labkit-note", make("summary", "", "mouse and keys"), help);
  foot.append(bar, hints, note);

  window.addEventListener("keydown", keys, true);
  const resized = new ResizeObserver((entries) => {
    for (const { target, contentRect: { width } } of entries) {
      if (target === canvas) {
        if (Math.abs(width - wide) > 1) verdict.style.minHeight = "";
        wide = width || wide;
      } else if (!verdict.classList.contains("labkit-error")) {
        verdict.style.minHeight = `${verdict.offsetHeight}px`; // a shorter sentence moves no slider
      }
    }
    if (Math.abs(ratio() - sent) > 0.003) ask("ready"); // also when it first gets its place
  });
  resized.observe(canvas);
  resized.observe(verdict);

  arrange();
  mark();
  const ended = (_, status) => (!status || /start|dead|terminating/.test(status)) && lose();
  for (const signal of ["statusChanged", "disposed"]) kernel?.[signal].connect(ended);
  model.on("msg:custom", answered);
  bitmap(model.get("first"), { mime: "image/png", size: [canvas.width, canvas.height], seq: 0 });
  ask("ready");
  return () => {
    model.off("msg:custom", answered);
    for (const signal of ["statusChanged", "disposed"]) kernel?.[signal].disconnect(ended);
    window.removeEventListener("keydown", keys, true);
    resized.disconnect();
    cancelAnimationFrame(frame);
    patience.forEach(clearTimeout);
    stop();
  };
}

export default { render };
