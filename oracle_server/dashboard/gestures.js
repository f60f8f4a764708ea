// How the timeline is moved: drag, wheel with Ctrl or Alt, pinch, double click, keys.

const CLICK = 4; // pixels: what moved farther was a drag
const SMOOTH = 300; // pixels of the wheel for a factor of e

const KEYS = {
  ArrowLeft: (window) => window.pan(-0.2),
  ArrowRight: (window) => window.pan(0.2),
  "+": (window) => window.zoom(0.5),
  "=": (window) => window.zoom(0.5),
  "-": (window) => window.zoom(2),
  0: (window) => window.all(),
  l: (window) => window.follow(),
};

/** Move `window` by what is done in `plots`, whose axis is `axis`; `clicked(share, target)` is called for a click, `enter(last)` to go into the rows. */
export function moveBy(plots, axis, window, { clicked, enter }) {
  const pointers = new Map();
  const shareAt = (event) => (event.clientX - axis.getBoundingClientRect().left) / axis.clientWidth;
  const apart = () => {
    const [one, other] = [...pointers.values()];
    return other === undefined ? 0 : Math.abs(one - other);
  };

  function zoomAt(event, factor) {
    if (window.live) window.show(window.since, window.until);
    window.zoom(factor, shareAt(event));
  }

  function grabbed(event) {
    const { target } = event;
    if (event.button !== 0 || !target.matches("canvas:not(.overview)")) return;
    pointers.set(event.pointerId, event.clientX);
    target.setPointerCapture(event.pointerId);
    const [begin, since, until] = [event.clientX, window.since, window.until];
    let dragged = false;
    const move = (now) => {
      const before = apart();
      pointers.set(now.pointerId, now.clientX);
      if (pointers.size > 1) return void (before && apart() && zoomAt(now, before / apart()));
      dragged ||= Math.abs(now.clientX - begin) > CLICK;
      const by = ((begin - now.clientX) / axis.clientWidth) * (until - since);
      if (dragged) window.show(since + by, until + by);
    };
    const end = (now) => {
      pointers.delete(now.pointerId);
      target.removeEventListener("pointermove", move);
      if (now.type === "pointerup" && !dragged) clicked(shareAt(now), target);
    };
    target.addEventListener("pointermove", move);
    for (const name of ["pointerup", "pointercancel"]) target.addEventListener(name, end, { once: true });
  }

  function wheeled(event) {
    if (!event.ctrlKey && !event.altKey) return;
    event.preventDefault();
    zoomAt(event, Math.exp(event.deltaY / SMOOTH));
  }

  function pressed(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const down = { ArrowDown: false, ArrowUp: true }[event.key];
    const act = KEYS[event.key];
    if (!act && down === undefined) return;
    event.preventDefault();
    if (act) act(window);
    else enter(down);
  }

  plots.addEventListener("pointerdown", grabbed);
  plots.addEventListener("dblclick", (event) => zoomAt(event, 0.25));
  plots.addEventListener("wheel", wheeled, { passive: false });
  plots.addEventListener("keydown", pressed);
}

/** Move `window` to where `overview`, which shows all of it, is pressed or dragged. */
export function jumpBy(overview, window) {
  const to = (event) => {
    const box = overview.getBoundingClientRect();
    const half = (window.until - window.since) / 2;
    const at = ((event.clientX - box.left) / box.width) * window.end;
    window.show(at - half, at + half);
  };
  overview.addEventListener("pointerdown", (event) => {
    overview.setPointerCapture(event.pointerId);
    to(event);
    overview.addEventListener("pointermove", to);
    overview.addEventListener("pointerup", () => overview.removeEventListener("pointermove", to), { once: true });
  });
}
