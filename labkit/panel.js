// The browser's half of a panel: sliders, hands, keys and pixels. The other half is panel.py.
//
// to the kernel    {kind, view, seq, ratio, scale, settled, …}: ready; set values; drag handle x y;
//   limits axes limits; start axes x y; clear; cursor t, or axes x y; hold on; large on; undo;
//   export what. One at a time waits for its answer, of others of its kind only the newest.
// from the kernel  {kind: "picture", …: Panel._picture} and two buffers (draw/record.py), or a mime
//   type and one buffer; {kind: "error", text, trace}; {kind: "said", text, or a file: name, mime}

function make(tag, own, ...children) {
  const node = document.createElement(tag);
  Object.assign(node, typeof own === "string" ? { className: own } : own);
  node.append(...children);
  return node;
}

const on = (node, actions, options) => {
  for (const [name, act] of Object.entries(actions)) node.addEventListener(name, act, options);
};
const clip = (x, low, high) => Math.min(Math.max(x, low), high);
const show = (x) => { // six digits; 1e20, not a one with twenty zeros
  const near = Number(Number(x).toPrecision(6));
  const text = Math.abs(near) >= 1e7 ? near.toExponential() : String(near);
  return text.replaceAll("-", "−").replace("e+", "e");
};
const read = (text) => Number(text.trim().replaceAll("−", "-").replace(",", ".") || NaN);

// A slider runs over positions: the value itself, or its decimal logarithm. The values that it can
// set lie on a grid that begins at `base`: Control.nearest of controls.py says the same.
function sliderRow(control, changed, refuse) {
  const { key, low, high, unit, step, base } = control;
  const log = control.kind === "log";
  const position = (value) => (log ? Math.log10(value) : value);
  const nearest = (at) => {
    const there = base + Math.floor((at - base) / step + 0.5) * step;
    const round = log ? (10 ** there).toPrecision(step < 1 ? 2 : 1) : there.toPrecision(12);
    return clip(Number(round), low, high);
  };
  const [min, max, title] = [position(low), position(high), control.name + control.index];
  const range = make("input", {
    className: "labkit-range", type: "range", min, max, step: "any",
    ariaLabel: `${title} ${control.meaning}`,
  });
  const field = make("input", {
    className: "labkit-value", type: "text", spellcheck: false, inputMode: "decimal",
    ariaLabel: `value of ${title}`,
  });
  let current, finger; // finger: one that moves the slider, or does not yet

  const write = () => { // the field is as wide as its number: all digits of it can be read
    field.ariaInvalid = null;
    field.value = show(current);
    field.style.setProperty("--digits", field.value.length);
  };
  const put = (x) => {
    range.value = position(x);
    if (x === current && !field.ariaInvalid) return;
    current = x;
    range.style.setProperty("--part", `${100 * clip((position(x) - min) / (max - min), 0, 1)}%`);
    range.ariaValueText = `${show(x)} ${unit}`;
    if (document.activeElement !== field || field.ariaInvalid) write(); // else someone writes in it
  };
  const move = (x, settled) => (x !== current || settled) && changed(key, x, settled);
  // Lab keeps the arrow keys from a native slider, so they are handled here.
  const keys = {
    ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1,
    PageUp: 10, PageDown: -10, Home: -1e9, End: 1e9,
  };
  // A finger moves a slider sideways only: up and down it scrolls the page, and a touch is no move.
  const still = () => finger && !finger.moves;
  on(range, {
    pointerdown({ pointerType: kind, clientX: from }) {
      finger = kind === "touch" && { from, value: current, moves: false };
    },
    pointermove: ({ clientX }) => finger && (finger.moves ||= Math.abs(clientX - finger.from) > 8),
    pointercancel: () => finger && move(finger.value, true),
    pointerup: () => setTimeout(() => (finger = null)), // after the change that it makes
    input: () => (still() ? put(current) : move(nearest(range.valueAsNumber), false)),
    change: () => (still() ? put(current) : move(current, true)),
    dblclick: () => move(control.value, true),
    keydown(event) {
      if (!(event.key in keys) || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      move(nearest(clip(position(current) + keys[event.key] * step, min, max)), false);
    },
    keyup: (event) => event.key in keys && move(current, true),
  });

  const typed = () => { // whether the field holds what the picture shows, now
    if (!field.ariaInvalid && field.value === show(current)) return true;
    let x = read(field.value);
    x = [low, high].find((end) => show(end) === show(x)) ?? x; // an end as it is shown
    const fits = x >= low && x <= high;
    if (fits) {
      move(x, true);
      write();
    } else {
      field.ariaInvalid = true;
      refuse(`${title}: “${field.value}” ${Number.isNaN(x) ? "is no number" : "is outside"}; ` +
        `type one from ${show(low)} to ${show(high)}${unit && ` ${unit}`}. ` +
        `The picture still shows ${show(current)}.`);
    }
    return fits;
  };
  on(field, {
    change: typed,
    keydown({ key: pressed }) {
      if (pressed === "Escape" && field.ariaInvalid) refuse(""); // what stands there is given up
      if (pressed === "Escape") write();
      if (pressed === "Escape" || (pressed === "Enter" && typed())) range.focus();
    },
  });
  const head = headOf(control, field, make("span", "labkit-unit", unit));
  return { row: make("div", "labkit-control", head, range), put };
}

function selectRow(control, changed) {
  const options = control.options.map((text) => make("option", "", text));
  const onchange = ({ target: { value } }) => changed(control.key, value, true);
  const select = make("select", { className: "labkit-select", onchange }, ...options);
  const row = make("label", "labkit-control", headOf(control), select);
  return { row, put: (x) => (select.value = x) };
}

function headOf({ name, index, meaning }, ...more) {
  const node = make("span", name.length === 1 ? "labkit-name labkit-letter" : "labkit-name", name);
  if (index) node.append(make("sub", "", index));
  return make("span", "labkit-head", node, make("span", "labkit-meaning", meaning), ...more);
}

// ---- the picture: what Matplotlib drew, stroke by stroke. An op learns its paths, or its place on
// a sheet of bitmaps, once: those of a recording come again as they are.
function unpack(parts, buffers) {
  const fresh = [...new Set(Object.values(parts).flat())].filter((op) => !op.paths && !op.sheet);
  const [floats, bytes] = buffers.map(({ buffer, byteOffset, byteLength }) =>
    buffer.slice(byteOffset, byteOffset + byteLength));
  const [points, pixels] = [new Float32Array(floats), new Uint8Array(bytes)];
  let [p, b, y] = [0, 0, 0];
  for (const op of fresh.filter(({ image }) => !image)) {
    let [last, down] = [new Path2D(), false];
    op.paths = [last];
    for (const end = p + 2 * op.n; p < end; p += 2) {
      const [x, y] = [points[p], points[p + 1]];
      if (!Number.isNaN(x)) last[down ? "lineTo" : "moveTo"](x, y);
      else if (y) last.closePath();
      else if (op.apart) op.paths.push((last = new Path2D()));
      down = !Number.isNaN(x);
    }
    op.places = op.at ? points.subarray(p, (p += 2 * op.at)) : [0, 0];
  }
  const texts = fresh.filter(({ image, rgba }) => image && !rgba);
  const width = Math.max(0, ...texts.map(({ image }) => image[2]));
  const height = texts.reduce((sum, { image }) => sum + image[3], 0);
  const sheet = make("canvas", { width, height }); // one for all words: to make a canvas takes long
  for (const op of fresh.filter(({ image }) => image)) {
    const [, , w, h] = op.image;
    const bitmap = new ImageData(w, h);
    if (op.rgba) bitmap.data.set(pixels.subarray(b, (b += 4 * w * h)));
    else {
      const ink = parseInt(op.fill.slice(1, 7).match(/../g).reverse().join(""), 16);
      const words = new Uint32Array(bitmap.data.buffer);
      for (let k = 0; k < w * h; k++) words[k] = ink | (pixels[b++] << 24);
    }
    const own = op.rgba && { sheet: make("canvas", { width: w, height: h }), y: 0 };
    Object.assign(op, own || { sheet, y });
    op.sheet.getContext("2d").putImageData(bitmap, 0, op.y);
    if (!own) y += h;
  }
}

function draw(context, op, zoom, draft) {
  context.save();
  context.scale(zoom, zoom);
  if (op.clip) {
    context.beginPath();
    context.rect(...op.clip);
    context.clip();
  }
  if (op.sheet) {
    const [x, y, w, h] = op.image;
    context.imageSmoothingQuality = "high";
    context.drawImage(op.sheet, 0, op.y, w, h, x, y, w, h);
  } else {
    // A line of one pixel is painted twenty times as fast: good while a hand moves.
    const thin = draft && !op.dash && op.width * zoom < 1.6;
    const lineWidth = thin ? Math.min(op.width, 1 / zoom) : op.width;
    const lineJoin = draft && op.width < 3 ? "miter" : op.join; // a round one takes longer
    const look = { fillStyle: op.fill, strokeStyle: op.stroke, lineCap: op.cap, lineJoin };
    const [lineDashOffset, ...dashes] = op.dash || [0];
    Object.assign(context, look, { lineWidth, lineDashOffset, miterLimit: 4 });
    context.setLineDash(dashes);
    for (let k = 0; k < op.places.length; k += 2) {
      context.setTransform(zoom, 0, 0, zoom, zoom * op.places[k], zoom * op.places[k + 1]);
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
  const queue = new Map(); // messages that wait, by what they replace
  const [rows, values, pointers] = [{}, {}, new Map()];
  let [seq, sent, flying, patience] = [0, 0, null, []]; // flying: what waits for its answer
  let [order, parts, base, newest, frame] = [null, {}, null, null, 0];
  let above = []; // parts from the first moving one on; those below it are kept as pixels
  let info = { axes: [], grips: [], span: [0, 1], t: null, verdict: spec.verdict };
  let [press, pinned, playing, chosen, current, rest] = [null, false, 0, -1, 0, 0];
  let wide = spec.width; // of the canvas on the page; an observer says it: asking costs a layout

  const ratio = () => {
    const dpr = window.devicePixelRatio || 1;
    const exact = (Math.round(wide * dpr) + 0.25) / spec.width; // whole pixels: nothing is blurred
    return Math.abs(wide - spec.width) < 1 ? dpr : exact;
  };
  const canvas = make("canvas", {
    className: "labkit-picture", width: spec.width * ratio(), height: spec.height * ratio(),
    role: "application", tabIndex: 0, ariaLabel: spec.alt, ariaRoleDescription: "live picture",
    ariaDescription: spec.help,
  });
  const live = (className, ...children) => make("div", { className, role: "status" }, ...children);
  const reading = live("labkit-reading", "\u00a0");
  const [opinion, stopped] = [make("span", "", spec.verdict), make("strong", "", spec.stopped)];
  const trouble = make("div");
  const verdict = live("labkit-verdict", stopped, opinion, trouble);
  const stage = make("div", "labkit-stage", canvas, reading, verdict);
  const [side, foot] = [make("div", "labkit-side"), make("div", "labkit-foot")];
  const style = `--w: ${Math.floor(spec.width)}px; --shape: ${spec.width / spec.height}; ` +
    `--least: ${spec.least || 0}px`;
  const room = make("fieldset", { className: "labkit-room", style }, stage, side, foot);
  el.classList.add("labkit-panel");
  el.append(room);

  // ---- messages
  const again = spec.download ? "reload this page" : "run the notebook again: Run ▸ Run All Cells";
  const post = () => {
    if (flying || !queue.size) return;
    const [key, message] = queue.entries().next().value;
    queue.delete(key);
    flying = message;
    sent = ratio();
    try {
      model.send({ ...message, view: me, seq: ++seq, ratio: sent, scale: wide / spec.width });
    } catch {
      return lose(); // the kernel was restarted, or is dead
    }
    patience = [400, 900, 8000].map((after) => setTimeout(wait, after, after));
  };
  const wait = (after) => {
    const cut = kernel && kernel.connectionStatus !== "connected";
    const text = cut ? "no connection to the kernel" : "the kernel is busy";
    if (after > 400) stop();
    const end = `no answer: ${text}; if it does not end, ${again}`;
    verdict.dataset.late = `… ${after > 900 ? end : text}`;
  };
  const calm = () => { // the kernel answers, or the message that was sent last is taken back
    patience.forEach(clearTimeout);
    delete verdict.dataset.late;
  };
  const lose = () => {
    flying = null;
    queue.clear();
    calm();
    stop();
    room.disabled = true; // and all its controls
    refuse(`This panel has no kernel any more: ${again}.`);
  };
  const ask = (kind, more = {}, key = kind) => {
    if (room.disabled && kind !== "ready") return;
    queue.set(key, { kind, ...more });
    post();
  };
  const each = (kind, more) => ask(kind, more, Symbol(kind)); // none of them takes another's place
  const set = (changes, settled, more = {}) => {
    ask("set", { values: { ...queue.get("set")?.values, ...changes }, settled, ...more });
  };
  const adopt = (news) => { // a value that was refused goes as soon as another one is taken
    Object.assign(values, news);
    const fixed = spec.fixed.includes(values.method) ? "fixed" : "adaptive";
    for (const { key, only } of spec.controls) {
      rows[key].put(values[key]);
      rows[key].row.hidden = only && only !== fixed;
    }
  };
  const changed = (key, value, settled) => {
    adopt({ [key]: value });
    set({ [key]: value }, settled);
  };
  const answered = (message, buffers) => {
    const mine = message.view === me;
    if (mine) {
      flying = null;
      calm();
      room.disabled = false;
      post(); // the next one is on its way before this one is painted
    }
    if (message.kind === "said" && mine) {
      if (message.name) save(new Blob(buffers, { type: message.mime }), message.name);
      tell(message.text);
    }
    if (message.kind === "error" && mine) judge(message);
    if (message.kind !== "picture") return;
    if (!flying?.values && !queue.has("set")) adopt(message.values); // else the hand is ahead
    take(message, buffers);
    say(reading, info.reading || "\u00a0");
    judge();
    mark();
  };
  const refuse = (text) => judge(text ? { kind: "error", text } : info);
  const say = (node, text) => node.textContent !== text && (node.textContent = text);
  const judge = ({ kind, stopped: early, verdict: words, text, trace } = info) => {
    el.classList.toggle("labkit-old", kind === "error"); // what is shown is not what was asked for
    verdict.classList.toggle("labkit-error", Boolean(early || kind === "error"));
    say(stopped, early || "");
    say(opinion, words || "");
    say(trouble, text || "");
    if (!trace) return;
    const lines = make("pre", { tabIndex: 0 }, trace);
    const ontoggle = () => (lines.scrollTop = lines.scrollHeight); // the end tells most
    trouble.append(make("details", { ontoggle }, make("summary", "", "where it happened"), lines));
  };
  // ---- the picture
  const take = async (message, buffers) => {
    info = message;
    if (message.mime) {
      const picture = await createImageBitmap(new Blob(buffers, { type: message.mime }));
      if (info !== message) return; // decoding is asynchronous: a newer one was faster
      [order, above, base] = [null, [], picture];
    } else {
      if (message.order) [order, parts, base] = [message.order, {}, null];
      if (!order) return; // the rest is on its way
      unpack(message.ops, buffers);
      Object.assign(parts, message.ops);
    }
    newest = message;
    frame ||= requestAnimationFrame(paint); // once for each frame
  };
  const layer = (target, ids, draft) => {
    const { size: [width, height], zoom = 1 } = newest;
    if (target.width !== width || target.height !== height) {
      Object.assign(target, { width, height });
      room.style.setProperty("--shape", width / height);
    }
    const context = target.getContext("2d", { alpha: false });
    if (base) context.drawImage(base, 0, 0, width, height);
    for (const id of ids) for (const op of parts[id]) draw(context, op, zoom, draft);
    return context;
  };
  const paint = () => {
    frame = 0;
    if (!base) {
      const still = [...order, "m"].findIndex((id) => id[0] === "m");
      above = order.slice(still);
      base = layer(make("canvas"), order.slice(0, still)).canvas; // the background, once
    }
    layer(canvas, above, newest.settled === false);
    if (newest.view === me) canvas.dataset.seq = newest.seq;
  };

  // ---- zoom: limits [x0, y0, x1, y1] are linear in pixels
  const asked = (k) => queue.get(`limits${k}`)?.limits || (flying?.axes === k && flying.limits);
  // What is at one place of the axes comes to another, in a picture of so many times their width.
  const pull = (k, factor, from, to) => {
    if (!info.axes[k]) return;
    const [left, top, width, height] = info.axes[k].box;
    const [fromX, fromY] = from ?? [left + width / 2, top + height / 2];
    const [toX, toY] = to ?? [fromX, fromY];
    const [x0, y0, x1, y1] = asked(k) || info.axes[k].limits;
    const [across, up] = [(x1 - x0) / width, (y1 - y0) / height]; // of a pixel
    const x = x0 + (fromX - left - factor * (toX - left)) * across;
    const y = y1 - (fromY - top - factor * (toY - top)) * up;
    const limits = [x, y - factor * height * up, x + factor * width * across, y];
    ask("limits", { axes: k, limits, settled: false }, `limits${k}`);
    clearTimeout(rest); // then labels find their places
    rest = setTimeout(() => ask("limits", { axes: k, limits }, `limits${k}`), 350);
  };
  const home = (k) => {
    clearTimeout(rest);
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
  const start = (x, y, k = over(x, y)) => at(k) === "plane" && each("start", { axes: k, x, y });
  const drag = (settled, x, y, handle = press.grip) => ask("drag", { handle, x, y, settled });
  // A finger that sets out up or down scrolls the page; sideways it moves the cursor or the axes.
  const intent = (dx, dy) => {
    if (press.grip >= 0) return "drag";
    if (press.axes < 0 || (press.touch && Math.abs(dy) > Math.abs(dx))) return "none";
    return press.touch && at(press.axes) === "time" ? "scrub" : "shift";
  };
  on(canvas, {
    pointerdown(event) {
      const [x, y, scale] = place(event);
      const [touch, axes] = [event.pointerType === "touch", over(x, y)];
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      pointers.set(event.pointerId, [x, y]);
      press = { x, y, touch, axes, grip: grip(x, y, (touch ? 24 : 12) * scale), act: "" };
      if (pointers.size > 1) press.act = "zoom";
      if (press.grip >= 0) chosen = press.grip;
      if (axes >= 0) current = axes;
    },
    pointermove(event) {
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
      const old = pointers.get(event.pointerId);
      const other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
      pointers.set(event.pointerId, [x, y]);
      if (press.act === "drag") drag(false, x, y);
      if (press.act === "shift") pull(press.axes, 1, old, [x, y]);
      if (press.act === "scrub") pin({ axes: press.axes, x, y });
      if (press.act !== "zoom" || !other) return;
      const far = ([a, b]) => Math.hypot(a - other[0], b - other[1]);
      const between = ([a, b]) => [(a + other[0]) / 2, (b + other[1]) / 2];
      pull(press.axes, far(old) / far([x, y]), between([x, y]));
    },
    pointerup(event) {
      const [x, y] = place(event);
      pointers.delete(event.pointerId);
      if (press?.act === "drag" && !pointers.size) drag(true, x, y);
    },
    pointercancel({ pointerId }) { // the page scrolls
      pointers.delete(pointerId);
      press = null;
    },
    pointerleave: () => !pinned && !playing && info.t !== null && ask("cursor", { t: null }),
    click(event) {
      if (!press || press.act || event.detail > 1) return;
      const { axes, x, y } = press;
      const handle = info.axes[axes]?.click ?? -1;
      if (handle >= 0) drag(true, x, y, handle);
      else if (press.grip < 0) start(x, y);
      if (at(axes) === "time" && handle < 0) pin({ axes, x, y });
    },
    dblclick(event) {
      const k = over(...place(event));
      if (k < 0) return;
      // Its first click was none.
      if (at(k) === "plane" && press?.grip < 0) each("clear", { last: 1 });
      home(k);
    },
  });
  on(canvas, {
    touchmove(event) { // no scrolling under a ring or two fingers
      const own = event.touches.length > 1 || press?.grip >= 0;
      if (own && event.cancelable) event.preventDefault();
    },
    wheel(event) {
      const [x, y] = place(event);
      const k = over(x, y);
      if (k < 0 || document.activeElement !== canvas) return; // the page still scrolls
      event.preventDefault();
      pull(k, 1.0015 ** clip(event.deltaY * (event.deltaMode ? 30 : 1), -300, 300), [x, y]);
    },
  }, { passive: false });

  // ---- time
  const pin = (where) => {
    stop();
    pinned = true;
    ask("cursor", where);
  };
  const toggle = () => {
    if (playing || !spec.moves) return stop();
    const [first, last] = info.span;
    const from = info.t === null || info.t >= last ? first : info.t;
    const clock = spec.time === "s" && last - first >= 2 && last - first <= 20; // as fast as it
    const speed = clock ? 1 : (last - first) / 10;
    const begin = performance.now();
    const step = (now) => {
      info.t = clip(from + ((now - begin) / 1000) * speed, first, last);
      ask("cursor", { t: info.t });
      if (info.t < last && playing) playing = requestAnimationFrame(step);
      else stop();
    };
    pinned = true;
    playing = requestAnimationFrame(step);
    buttons.play.textContent = "❚❚ Pause";
    reading.ariaLive = "off"; // nobody can listen that fast
  };
  const stop = () => {
    cancelAnimationFrame(playing);
    playing = 0;
    reading.ariaLive = null;
    if (buttons.play) buttons.play.textContent = "▶ Play";
  };
  const free = () => {
    pinned = false;
    stop();
    ask("cursor", { t: null });
  };

  // ---- keys
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const clear = () => ask("clear");
  const held = () => info.grips[chosen];
  const plain = {
    " ": toggle, Escape: free, Delete: clear, Backspace: clear, 0: homes,
    "+": () => pull(current, 0.8), "=": () => pull(current, 0.8), "-": () => pull(current, 1.25),
    a() {
      current = (current + 1) % info.axes.length;
      tell(`zoom: axes ${current + 1} of ${info.axes.length}`);
    },
    Enter() {
      chosen = chosen + 2 > info.grips.length ? -1 : chosen + 1;
      const name = chosen < 0 ? "the time cursor" : spec.handles[chosen];
      if (spec.handles.length) tell(`arrow keys move: ${name}`);
    },
    n: () => start(...(held() || info.grips[0] || [])),
  };
  on(canvas, {
    keydown(event) {
      const [act, arrow, ring] = [plain[event.key], arrows[event.key], held()];
      if (event.ctrlKey || event.metaKey || !info.axes.length || !(act || arrow)) return;
      event.preventDefault();
      if (act) return act();
      const big = event.shiftKey ? 0.1 : 0.01;
      const moves = ring && !event.altKey; // a ring moves by its own axes' width
      const far = big * (info.axes[moves ? over(...ring) : -1] ?? info.axes[current]).box[2];
      if (event.altKey) pull(current, 1, arrow.map((x) => 5 * far * x), [0, 0]);
      else if (ring) drag(false, (ring[0] += far * arrow[0]), (ring[1] += far * arrow[1]), chosen);
      else if (arrow[0] && spec.moves) {
        const [first, last] = info.span;
        info.t = clip((info.t ?? first) + arrow[0] * big * (last - first), first, last);
        pin({ t: info.t });
      }
    },
    keyup: (event) => event.key in arrows && held() && !event.altKey && set({}, true), // it rests
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
    each("undo");
  };

  // ---- controls
  for (const group of new Set(spec.controls.map((control) => control.group))) {
    const grid = make("div", "labkit-grid");
    for (const control of spec.controls.filter((one) => one.group === group)) {
      const { row } = (rows[control.key] =
        (control.kind === "select" ? selectRow : sliderRow)(control, changed, refuse));
      const unit = control.unit && `in ${control.unit}`;
      row.title = [control.meaning, unit].filter(Boolean).join(", ");
      grid.append(row);
    }
    side.append(make("fieldset", "labkit-group", make("legend", "", group), grid));
  }
  if (!side.firstChild) room.classList.add("labkit-bare");
  room.classList.toggle("labkit-wide", spec.least > 540); // no room for sliders beside it
  const [bar, note, buttons] = [make("div", "labkit-bar"), live("labkit-note labkit-said"), {}];
  const tell = (text) => Object.assign(note, { textContent: text, title: text });
  const mark = () => { // what the buttons say of the panel's state, whoever has changed it
    const home = info.axes.every((one) => one.home);
    const idle = { undo: !info.undo, clear: !info.begun, home };
    for (const [key, node] of Object.entries(buttons)) {
      node.disabled = Boolean(idle[key]);
      if (key === "hold" || key === "large") node.ariaPressed = Boolean(info[key]);
    }
    el.classList.toggle("labkit-large", Boolean(info.large));
  };
  const reset = () => {
    free();
    homes();
    set({}, true, { reset: true, home: true });
  };
  const save = (blob, download) => {
    const link = make("a", { href: URL.createObjectURL(blob), download });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
  };
  const copy = () => {
    tell(info.code);
    getSelection().selectAllChildren(note); // where copying is not allowed it is ready for Ctrl-C
    navigator.clipboard?.writeText(info.code).then(() => tell(`copied: ${info.code}`), () => {});
  };
  const full = () =>
    document.fullscreenElement ? document.exitFullscreen() : el.requestFullscreen();
  const button = (title, text, onclick, name = "") =>
    make("button", { className: "labkit-button", type: "button", title, name, onclick }, text);
  const presets = Object.entries(spec.presets).map(([text, changes]) => button(
    "sets the sliders to values of the notebook", text, () => set(changes, true, { reset: true })));
  const words = make("span", "labkit-note", "try");
  if (presets.length) verdict.after(make("div", "labkit-bar labkit-presets", words, ...presets));
  const acts = {
    play: toggle, undo: () => each("undo"), reset, home: homes, clear, full, code: copy,
    hold: () => ask("hold", { on: !info.hold }), large: () => ask("large", { on: !info.large }),
  };
  for (const [key, text, title] of spec.buttons) {
    if (key === "full" && !document.fullscreenEnabled) continue;
    buttons[key] = button(title, text, acts[key] || (() => each("export", { what: key })), key);
    bar.append(buttons[key]);
  }
  foot.append(bar, spec.recorded ? make("div", "labkit-note", spec.help)
    : make("details", "labkit-note", make("summary", "", "mouse and keys"), spec.help), note);

  const resized = new ResizeObserver(([{ contentRect: { width } }]) => {
    wide = width || wide;
    if (Math.abs(ratio() - sent) > 0.003) ask("ready"); // also when it first gets its place
  });
  resized.observe(canvas);
  window.addEventListener("keydown", keys, true);
  const ended = (_, status) => (!status || /start|dead|terminating/.test(status)) && lose();
  for (const signal of ["statusChanged", "disposed"]) kernel?.[signal].connect(ended);
  model.on("msg:custom", answered);

  adopt(Object.fromEntries(spec.controls.map(({ key, value }) => [key, value])));
  mark();
  const size = [canvas.width, canvas.height];
  take({ ...info, mime: "image/png", size, seq: 0, view: me }, [model.get("first")]);
  ask("ready");
  return () => {
    model.off("msg:custom", answered);
    for (const signal of ["statusChanged", "disposed"]) kernel?.[signal].disconnect(ended);
    window.removeEventListener("keydown", keys, true);
    resized.disconnect();
    calm();
    stop();
  };
}

export default { render };
