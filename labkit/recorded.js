// Plays a recording (recorded.py) in a page: stands for the kernel of panel.js, which comes before.

const bytesOf = (text) => Uint8Array.from(atob(text.trim()), (letter) => letter.charCodeAt(0));

async function unpacked(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const data = new Uint8Array(await new Response(stream).arrayBuffer());
  let at = data.indexOf(10) + 1;
  const tape = JSON.parse(new TextDecoder().decode(data.subarray(0, at)));
  const count = tape.parts.reduce((sum, part) => sum + part.points, 0);
  const planes = [0, 1, 2, 3].map((k) => data.subarray(at + k * count, at + (k + 1) * count));
  at += 4 * count;
  tape.images = tape.images.map((size) => data.subarray(at, (at += size)));
  let p = 0;
  for (const part of tape.parts) { // differences on a grid: recorded.py, _differences
    part.floats = part.raw === undefined ? new Float32Array(2 * part.points)
      : new Float32Array(tape.images[part.raw].slice().buffer); // points far outside
    let [x, y] = [0, 0];
    for (let k = 0; k < part.points; k++, p++) {
      const [dx, dy] = [0, 2].map((q) => ((planes[q][p] | (planes[q + 1][p] << 8)) << 16) >> 16);
      const up = dx === -32768;
      if (!up) [x, y] = [x + dx, y + dy];
      part.floats.set(up ? [NaN, dy] : [x / tape.grid, y / tape.grid], 2 * k);
    }
  }
  return tape;
}

function joined(arrays) {
  const whole = new Uint8Array(arrays.reduce((sum, one) => sum + one.length, 0));
  let at = 0;
  for (const one of arrays) {
    whole.set(one, at);
    at += one.length;
  }
  return new DataView(whole.buffer);
}

// What a picture says of hands, of which a recording has none
const NOTHING = {
  kind: "picture", axes: [], grips: [], begun: 0, undo: 0, hold: false, large: false, code: "",
};

function kernel(tape, picture) {
  let [listeners, now, shown, background] = [[], tape.first, {}, ""]; // shown: parts on the page
  const near = (list, x) =>
    list.reduce((best, one) => (Math.abs(one[0] - x) < Math.abs(best[0] - x) ? one : best));
  const wanted = ({ kind, values = {}, t, reset }) => {
    if (kind === "cursor" && t != null && tape.instants.length) return near(tape.instants, t)[1];
    if (kind !== "set") return now; // the page has another size, say
    const changes = JSON.stringify(values);
    const preset = reset && Object.keys(tape.presets).find(
      (name) => JSON.stringify(tape.spec.presets[name]) === changes);
    if (preset) return tape.presets[preset];
    const key = Object.keys(values).pop();
    if (!key || reset) return tape.first;
    const there = tape.sliders[key];
    const same = there.find(([value]) => value === values[key]);
    return (same || near(there, values[key]))[1];
  };
  const answer = ({ kind, view, seq, settled, ratio, ...more }) => {
    now = wanted({ kind, ...more });
    const frame = tape.frames[now];
    if (frame.error) return [{ kind: "error", text: frame.error, view, seq }, []];
    const zoom = ratio / tape.ratio; // strokes are laid on the pixels that the page has
    const size = frame.size.map((side) => Math.floor(side * zoom + 0.01));
    const message = { ...NOTHING, ...frame, size, zoom, view, seq, settled };
    if (frame.mime) {
      background = "";
      return [message, [tape.images[frame.bitmap]]];
    }
    const names = frame.order.map(([name]) => name);
    const still = frame.order.filter(([name]) => name[0] === "s").join() + names;
    const all = kind === "ready" || still !== background;
    const news = frame.order.filter(([name, part]) => all || shown[name] !== part);
    [shown, background] = [Object.fromEntries(frame.order), still];
    const ops = Object.fromEntries(news.map(([name, part]) => [name, tape.parts[part].ops]));
    const fresh = [...new Set(news.map(([, part]) => tape.parts[part]))].filter(
      (part) => !part.sent && (part.sent = true)); // the page keeps what it has made of them
    const pixels = fresh.flatMap((part) => part.ops.filter((op) => op.image))
      .map((op) => tape.images[op.bitmap]);
    const floats = fresh.map((part) => new Uint8Array(part.floats.buffer));
    return [{ ...message, ops, order: all ? names : undefined }, [joined(floats), joined(pixels)]];
  };
  return {
    get: (name) => (name === "spec" ? tape.spec : picture),
    on: (_, listener) => listeners.push(listener),
    off: (_, listener) => (listeners = listeners.filter((one) => one !== listener)),
    send: (message) => queueMicrotask(() => {
      const [content, buffers] = answer(message);
      for (const listener of listeners) listener(content, buffers);
    }),
  };
}

for (const place of document.querySelectorAll(".labkit-recording")) {
  const play = async () => {
    const tape = await unpacked(bytesOf(place.querySelector("script").textContent));
    const picture = bytesOf(place.querySelector("img").src.split(",")[1]).buffer;
    const el = document.createElement("div");
    render({ model: kernel(tape, picture), el });
    place.replaceChildren(el);
  };
  // Unpacked when the reader comes near: a page with several panels opens at once.
  const watch = new IntersectionObserver((entries) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    watch.disconnect();
    play().catch((error) => console.error("labkit:", error)); // the picture stays
  }, { rootMargin: "600px" });
  watch.observe(place);
}
