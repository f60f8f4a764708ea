// The bar at the bottom of a narrow page: it goes to the parts of a session, and says which one is in view.

import { h } from "./dom.js";

const ABOVE = 0.1; // of the screen: what begins above is what is read

/** A bar of the parts in `node`, by the selectors of `parts`; `missing(name)` is called for one that is not there yet. */
export function barView(node, parts, missing) {
  const part = (name) => [...node.querySelectorAll(parts[name])].find((each) => each.clientHeight > 0);
  const buttons = Object.keys(parts).map((name) => h("button", { type: "button", onclick: () => go(name) }, name));
  const bar = h("nav", { class: "bar", "aria-label": "Parts of the session" }, buttons);
  let [frame, wanted] = [null, null];

  function go(name) {
    const found = part(name);
    wanted = found ? null : name;
    if (found) found.scrollIntoView({ block: "start" });
    else missing(name);
  }

  /** Go to what was missing once it is there, and say where the page is. */
  function show() {
    if (wanted && part(wanted)) go(wanted);
    frame ??= requestAnimationFrame(() => {
      frame = null;
      const tops = Object.keys(parts).map((name) => part(name)?.getBoundingClientRect().top ?? Infinity);
      const here = tops.findLastIndex((top) => top < ABOVE * innerHeight);
      buttons.forEach((each, i) => (i === Math.max(0, here) ? each.setAttribute("aria-current", "true") : each.removeAttribute("aria-current")));
    });
  }

  addEventListener("scroll", show, { passive: true });
  return { node: bar, show, leave: () => {
    removeEventListener("scroll", show);
    cancelAnimationFrame(frame);
  } };
}
