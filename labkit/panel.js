// The browser's half of a panel: sliders, hands and keys, and the pixels. See panel.py for the other half.
//
// to the kernel    {kind, view, seq, ratio, scale, settled, …}: ready; set values; drag handle x y; limits axes limits; start axes x y; clear; cursor t, or axes x y;
//                  hold on; large on; export what. One at a time waits for its answer; of those that may wait only the newest is kept, so nothing lags behind.
// from the kernel  {kind: "picture", view, seq, verdict, values, axes, grips, t, span, reading, begun, size, order, ops} and two buffers (draw/record.py),
//                  or with a mime type and one buffer; {kind: "error", text, trace}; {kind: "said", text}

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
    Object.assign(context, { fillStyle: op.fill, strokeStyle: op.stroke, lineWidth: width, lineCap: op.cap, lineJoin: draft && width < 3 ? "miter" : op.join, miterLimit: 4 });
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
  const queue = new Map(); // messages that wait, by what they replace
  const [rows, grids, wanted, pointers] = [{}, {}, {}, new Map()]; // wanted: limits that the user has asked for, by axes
  let [seq, sent, flying, patience] = [0, 0, null, []]; // flying: the message that waits for its answer
  let [order, parts, base, newest, frame, slow] = [null, {}, null, null, 0, false]; // the picture: parts in drawing order
  let above = []; // those from the first moving one on; the ones below it are kept as pixels
  let info = { axes: [], grips: [], span: [0, 1], t: null };
  let [shot, press, pinned, playing, chosen, current, rest] = [null, null, false, 0, -1, 0, 0];
  let wide = spec.width; // of the canvas on the page; measured by an observer, since asking for it makes the browser lay out the page at once

  el.classList.add("labkit-panel");
  const canvas = make("canvas", "labkit-picture");
  canvas.style.width = `${Math.floor(spec.width)}px`;
  const ratio = () => {
    const dpr = window.devicePixelRatio || 1;
    return Math.abs(wide - spec.width) < 1 ? dpr : (Math.round(wide * dpr) + 0.25) / spec.width; // whole pixels, so that nothing is blurred
  };
  const help = "click: trajectory from there · drag: a ring, or the picture · wheel: zoom · double click: back · arrow keys: move the cursor or a ring, Enter: which · " +
    "Space: play · + − 0: zoom · a: next axes · Alt-arrows: shift · n: trajectory from the ring · Delete: clear";
  const attributes = { role: "application", tabindex: 0, "aria-label": spec.alt, "aria-roledescription": "live picture", "aria-description": help };
  for (const [name, text] of Object.entries(attributes)) canvas.setAttribute(name, text);
  const reading = make("div", "labkit-reading", "\u00a0");
  const verdict = make("div", "labkit-verdict", spec.verdict);
  verdict.setAttribute("role", "status");
  el.append(canvas, reading, verdict);
  Object.assign(canvas, { width: spec.width * ratio(), height: spec.height * ratio() });

  // ---- messages
  const post = () => {
    if (flying || !queue.size) return;
    const [key, message] = queue.entries().next().value;
    queue.delete(key);
    flying = message;
    sent = ratio();
    model.send({ ...message, view: me, seq: ++seq, ratio: sent, scale: wide / spec.width });
    if (message.kind === "cursor") return;
    patience = [[400, "the kernel is busy"], [8000, "no answer: the kernel is busy, or it was restarted; then run the cell again"]].map(([time, text]) =>
      setTimeout(() => (verdict.dataset.late = `  … ${text}`), time));
  };
  const ask = (kind, more = {}, key = kind) => {
    queue.set(key, { kind, ...more });
    post();
  };
  const set = (changes, settled, more = {}) => ask("set", { values: { ...queue.get("set")?.values, ...changes }, settled, ...more });
  const changed = (key, value, settled) => {
    values[key] = value;
    arrange();
    set({ [key]: value }, settled);
  };
  const answered = async (message, buffers) => {
    const mine = message.view === me;
    if (mine) {
      flying = null;
      patience.forEach(clearTimeout);
      delete verdict.dataset.late;
      post(); // the next one is on its way before this one is painted
    }
    if (message.kind === "said") note.textContent = message.text;
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
      frame ||= requestAnimationFrame(paint); // only the newest picture of each animation frame is painted
    }
    say(reading, message.reading || "\u00a0");
    buttons.clear.hidden = !message.begun;
    verdict.classList.remove("labkit-error");
    say(verdict, message.verdict);
  };
  const say = (node, text) => node.textContent !== text && (node.textContent = text);
  const complain = (message) => {
    verdict.classList.add("labkit-error");
    verdict.replaceChildren(make("div", "", message.text));
    for (const key of Object.keys(wanted)) delete wanted[key];
    if (!message.trace) return;
    const [more, trace] = [make("details"), make("pre", "", message.trace)];
    more.append(make("summary", "", "where it happened"), trace);
    more.addEventListener("toggle", () => (trace.scrollTop = trace.scrollHeight)); // the last lines tell most
    verdict.append(more);
  };

  // ---- the picture
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
      const first = order.findIndex((id) => id[0] === "m");
      above = first < 0 ? [] : order.slice(first);
      base = layer(make("canvas"), order.slice(0, order.length - above.length), newest.size).canvas; // the still background, once
      if (newest.settled !== false) {
        const begin = performance.now();
        layer(make("canvas"), above, newest.size).getImageData(0, 0, 1, 1); // waits until all is painted
        slow = performance.now() - begin > 12;
      }
    }
    layer(canvas, above, newest.size, slow && newest.settled === false);
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

  // ---- zoom: the limits [x0, y0, x1, y1] are linear in pixels; until the kernel's picture comes, the one there is is stretched
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
    const [sx, sy] = [((x1 - x0) / (c - a)), ((y1 - y0) / (d - b))];
    context.setTransform(sx, 0, 0, sy, left + ((x0 - a) / (c - a)) * width - left * sx, top + ((d - y1) / (d - b)) * height - top * sy);
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
    rest = setTimeout(() => ask("limits", more, `limits${k}`), 350); // then the labels find their places
  };
  const about = (k, x, y) => {
    const [left, top, width, height] = info.axes[k].box;
    return ([x0, y0, x1, y1]) => [x0 + ((x - left) / width) * (x1 - x0), y1 - ((y - top) / height) * (y1 - y0)];
  };
  const zoom = (k, factor, x, y) => relimit(k, (old) => {
    const [px, py] = about(k, x, y)(old);
    return old.map((value, i) => (i % 2 ? py : px) + (value - (i % 2 ? py : px)) * factor);
  });
  const shift = (k, dx, dy) => relimit(k, (old) => {
    const [, , width, height] = info.axes[k].box;
    return old.map((value, i) => value - (i % 2 ? (-dy / height) * (old[3] - old[1]) : (dx / width) * (old[2] - old[0])));
  });
  const home = (k) => {
    clearTimeout(rest);
    delete wanted[k];
    if (!info.axes[k].home) ask("limits", { axes: k, limits: null }, `limits${k}`);
  };

  // ---- mouse and fingers
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    const scale = canvas.width / box.width;
    return [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale, scale];
  };
  const over = (x, y) => info.axes.findIndex(({ box: [left, top, width, height] }) => x >= left && x <= left + width && y >= top && y <= top + height);
  const grip = (x, y, reach) => {
    const away = info.grips.map(([a, b]) => Math.hypot(a - x, b - y));
    const nearest = away.indexOf(Math.min(...away));
    return away[nearest] <= reach ? nearest : -1;
  };
  const listen = (name, action, options) => canvas.addEventListener(name, action, options);
  listen("pointerdown", (event) => {
    const [x, y, scale] = place(event);
    const shifts = event.pointerType !== "touch" || document.activeElement === canvas; // until it has the focus, a finger scrolls the page
    canvas.focus({ preventScroll: true });
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [x, y]);
    press = { x, y, grip: grip(x, y, (event.pointerType === "touch" ? 24 : 12) * scale), axes: over(x, y), moved: pointers.size > 1, shifts };
    if (press.grip >= 0) chosen = press.grip;
    if (press.axes >= 0) current = press.axes;
  });
  listen("pointermove", (event) => {
    const [x, y, scale] = place(event);
    const k = over(x, y);
    if (!press || !pointers.has(event.pointerId)) {
      canvas.style.cursor = grip(x, y, 12 * scale) >= 0 ? "grab" : k < 0 ? "" : "crosshair";
      if (k >= 0 && info.axes[k].kind === "time" && !pinned && !playing) ask("cursor", { axes: k, x, y });
      return;
    }
    const [oldX, oldY] = pointers.get(event.pointerId);
    press.moved ||= Math.hypot(x - press.x, y - press.y) > 4 * scale;
    if (!press.moved) return;
    const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
    pointers.set(event.pointerId, [x, y]);
    if (other && press.axes >= 0) zoom(press.axes, Math.hypot(oldX - other[0], oldY - other[1]) / Math.hypot(x - other[0], y - other[1]), (x + other[0]) / 2, (y + other[1]) / 2);
    else if (press.grip >= 0) ask("drag", { handle: press.grip, x, y, settled: false });
    else if (press.axes >= 0 && press.shifts) shift(press.axes, x - oldX, y - oldY);
  });
  const lifted = (event) => {
    const [x, y] = place(event);
    pointers.delete(event.pointerId);
    if (!press || pointers.size) return;
    if (event.type === "pointercancel") {
      press = null;
      return canvas.blur(); // the finger scrolls the page, and so will the next one
    }
    if (press.grip >= 0 && press.moved) ask("drag", { handle: press.grip, x, y, settled: true });
    [press.x, press.y] = [x, y];
  };
  listen("pointerup", lifted);
  listen("pointercancel", lifted);
  listen("touchmove", (event) => event.cancelable && (event.touches.length > 1 || press?.grip >= 0) && event.preventDefault(), { passive: false }); // no scrolling
  listen("click", (event) => {
    if (!press || press.moved || press.axes < 0 || event.detail > 1) return;
    const { axes, x, y } = press;
    if (info.axes[axes].kind === "plane" && press.grip < 0) ask("start", { axes, x, y }, Symbol("start"));
    if (info.axes[axes].kind !== "time") return;
    pinned = true;
    ask("cursor", { axes, x, y });
  });
  listen("dblclick", (event) => {
    const k = over(...place(event));
    if (k < 0) return;
    if (info.axes[k].kind === "plane" && press?.grip < 0) ask("clear", { last: 1 }, Symbol("clear")); // its first click was none
    home(k);
  });
  listen("pointerleave", () => !pinned && !playing && info.t !== null && ask("cursor", { t: null }));
  listen("wheel", (event) => {
    const [x, y] = place(event);
    const k = over(x, y);
    if (k < 0 || document.activeElement !== canvas) return; // the page still scrolls
    event.preventDefault();
    zoom(k, 1.0015 ** clip(event.deltaY * (event.deltaMode ? 30 : 1), -300, 300), x, y);
  }, { passive: false });

  // ---- keys
  const cursor = (t) => {
    pinned = true;
    info.t = clip(t, ...info.span);
    ask("cursor", { t: info.t });
  };
  const play = () => {
    const [first, last] = info.span;
    const from = info.t === null || info.t >= last ? first : info.t;
    const speed = spec.time === "s" && last - first >= 2 && last - first <= 20 ? 1 : (last - first) / 10; // as fast as the clock where that takes 2 to 20 s
    let begin;
    const step = (now) => {
      begin ??= now;
      const t = Math.min(from + ((now - begin) / 1000) * speed, last);
      cursor(t);
      if (t < last) playing = requestAnimationFrame(step);
      else stop();
    };
    playing = requestAnimationFrame(step);
    buttons.play.textContent = "❚❚ Pause";
  };
  const stop = () => {
    cancelAnimationFrame(playing);
    playing = 0;
    if (buttons.play) buttons.play.textContent = "▶ Play";
  };
  const toggle = () => (playing ? stop() : play());
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  listen("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || !info.axes.length) return;
    const { box: [left, top, width, height] } = info.axes[current];
    const [middle, high] = [left + width / 2, top + height / 2];
    const ring = info.grips[chosen];
    const act = {
      " ": toggle, Delete: () => ask("clear"), Backspace: () => ask("clear"), "+": () => zoom(current, 0.8, middle, high), "=": () => zoom(current, 0.8, middle, high),
      "-": () => zoom(current, 1.25, middle, high), 0: () => info.axes.forEach((_, k) => home(k)),
      Escape: () => { pinned = false; stop(); ask("cursor", { t: null }); },
      a: () => { current = (current + 1) % info.axes.length; note.textContent = `zoom: axes ${current + 1} of ${info.axes.length}`; },
      Enter: () => { chosen = chosen + 2 > info.grips.length ? -1 : chosen + 1; note.textContent = `arrow keys move: ${chosen < 0 ? "the time cursor" : spec.handles[chosen]}`; },
      n: () => { const [x, y] = ring || info.grips[0] || []; if (x !== undefined && over(x, y) >= 0) ask("start", { axes: over(x, y), x, y }, Symbol("start")); },
    }[event.key];
    const arrow = arrows[event.key];
    if (!act && !arrow) return;
    event.preventDefault();
    if (act) return act();
    const own = ring && !event.altKey && over(...ring) >= 0 ? info.axes[over(...ring)].box[2] : width; // a ring moves by the width of its own axes
    const far = (event.shiftKey ? 0.1 : 0.01) * own;
    if (event.altKey) shift(current, -5 * far * arrow[0], -5 * far * arrow[1]);
    else if (ring) ask("drag", { handle: chosen, x: (ring[0] += far * arrow[0]), y: (ring[1] += far * arrow[1]), settled: false });
    else if (arrow[0]) cursor((info.t ?? info.span[0]) + arrow[0] * (event.shiftKey ? 0.1 : 0.01) * (info.span[1] - info.span[0]));
  });
  listen("keyup", (event) => {
    if (event.key in arrows && info.grips[chosen] && !event.altKey) set({}, true); // the hand rests
  });

  // ---- controls
  for (const control of spec.controls) {
    if (!(control.group in grids)) {
      grids[control.group] = make("div", "labkit-grid");
      const group = make("fieldset", "labkit-group");
      group.append(make("legend", "", control.group), grids[control.group]);
      el.append(group);
    }
    rows[control.key] = (control.kind === "select" ? selectRow : sliderRow)(control, changed);
    rows[control.key].put(control.value);
    rows[control.key].row.title = [control.meaning, control.unit && `in ${control.unit}`].filter(Boolean).join(", ");
    grids[control.group].append(rows[control.key].row);
  }
  const sync = (newest, held = {}) => {
    const news = Object.keys(rows).filter((key) => key in newest && !(key in held) && newest[key] !== values[key]);
    for (const key of news) rows[key].put((values[key] = newest[key]));
    if (news.length) arrange();
  };
  const arrange = () => {
    for (const { key, only } of spec.controls) {
      if (only) rows[key].row.hidden = (only === "fixed") !== spec.fixed.includes(values.method);
    }
  };
  const [bar, note, buttons] = [make("div", "labkit-bar"), make("span", "labkit-note"), {}];
  const button = (text, title, action, where = bar) => {
    const node = make("button", "labkit-button", text);
    Object.assign(node, { type: "button", title });
    node.addEventListener("click", () => action(node));
    where.append(node);
    return node;
  };
  const lasting = (kind) => (node) => {
    const on = node.getAttribute("aria-pressed") !== "true";
    node.setAttribute("aria-pressed", on);
    ask(kind, { on }, kind);
  };
  if (Object.keys(spec.presets).length) {
    const row = make("div", "labkit-bar labkit-presets");
    row.append(make("span", "labkit-note", "try"));
    for (const [text, changes] of Object.entries(spec.presets)) button(text, "sets the sliders to values of the notebook", () => set(changes, true, { reset: true }), row);
    verdict.after(row);
  }
  if (spec.moves) buttons.play = button("▶ Play", "lets the cursor run through the time (Space)", toggle);
  button("Reset", "all values back to those of the notebook", () => set({}, true, { reset: true }));
  if (spec.moves) button("Hold", "keeps the run on show as a grey ghost, to compare others with it", lasting("hold"));
  buttons.clear = button("Clear", "takes away the trajectories that clicks have started (Delete)", () => ask("clear"));
  buttons.clear.hidden = true;
  button("Classroom", "large letters, thick lines, axes that stay", lasting("large"));
  for (const what of ["csv", "npz", "png"]) button(`Save ${what.toUpperCase()}`, "beside the notebook", () => ask("export", { what }, Symbol(what)));
  const hints = make("details", "labkit-note");
  hints.append(make("summary", "", "mouse and keys"), make("div", "", help));
  bar.append(note, hints);
  note.setAttribute("role", "status");
  el.append(bar);
  // Lab's own keys (arrows, a, b, d d …) rest while the panel has the focus, but Ctrl-S still saves and Shift-Enter still runs.
  const keys = (event) => {
    const lab = event.ctrlKey || event.metaKey || (event.shiftKey && event.key === "Enter");
    if (el.contains(event.target)) event.target.toggleAttribute("data-lm-suppress-shortcuts", !lab);
  };
  window.addEventListener("keydown", keys, true);
  const resized = new ResizeObserver((entries) => {
    for (const { target, contentRect } of entries) {
      if (target === canvas) wide = contentRect.width || wide;
      else if (!verdict.classList.contains("labkit-error")) verdict.style.minHeight = `${verdict.offsetHeight}px`; // a shorter sentence does not move the sliders
    }
    if (Math.abs(ratio() - sent) > 0.003) ask("ready"); // also when it first gets its place
  });
  resized.observe(canvas);
  resized.observe(verdict);

  arrange();
  model.on("msg:custom", answered);
  bitmap(model.get("first"), { mime: "image/png", size: [canvas.width, canvas.height], seq: 0 });
  ask("ready");
  return () => {
    model.off("msg:custom", answered);
    window.removeEventListener("keydown", keys, true);
    resized.disconnect();
    cancelAnimationFrame(frame);
    stop();
  };
}

export default { render };
