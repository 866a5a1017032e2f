// Slides: arrow keys, page keys, space, Home and End; a swipe; the number stands in the address.
{
  const slides = [...document.querySelectorAll("section")];
  const count = document.createElement("div");
  count.className = "labkit-count";
  document.body.append(count);
  let now = 0;
  const go = (k) => {
    now = Math.min(Math.max(k, 0), slides.length - 1);
    slides.forEach((slide, j) => slide.classList.toggle("labkit-now", j === now));
    count.textContent = `${now + 1} / ${slides.length}`;
    history.replaceState(null, "", `#${now + 1}`);
  };
  const steps = { ArrowRight: 1, ArrowDown: 1, PageDown: 1, " ": 1, ArrowLeft: -1, ArrowUp: -1 };
  Object.assign(steps, { PageUp: -1, Backspace: -1, Home: -1e6, End: 1e6 });
  document.addEventListener("keydown", (event) => {
    if (!(event.key in steps) || event.ctrlKey || event.altKey || event.metaKey) return;
    if (event.target.closest?.(".labkit-panel, input, select, button, a, summary")) return;
    event.preventDefault();
    go(now + steps[event.key]);
  });
  let begin = null;
  document.addEventListener("touchstart", (event) => {
    begin = event.target.closest(".labkit-panel") ? null : event.touches[0].clientX;
  });
  document.addEventListener("touchend", (event) => {
    const far = begin === null ? 0 : event.changedTouches[0].clientX - begin;
    if (Math.abs(far) > 60) go(now - Math.sign(far));
  });
  window.addEventListener("hashchange", () => go(Number(location.hash.slice(1)) - 1 || 0));
  go(Number(location.hash.slice(1)) - 1 || 0);
}
