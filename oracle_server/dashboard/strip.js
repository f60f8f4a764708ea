// What held when, as a thin drawing: thin where it holds, tall where it fails.

import { svg } from "./dom.js";

const WIDE = 1000;
const LEAST = 3; // of WIDE: what is shorter is still seen
const HEIGHTS = { holds: [8, 4], fails: [2, 16], unknown: [5, 10], moot: [8, 4], no: [9.5, 1], not_told: [9.5, 1] };

/**
 * A strip of `[from, to, what]`, with shares (0 to 1) of its width; `cursor` is one too, null for none. `moot` holds, and `no`
 * fails, without need. What fails is drawn `least` thousandths wide at least.
 */
export function strip(runs, cursor = null, least = LEAST) {
  const drawn = runs.filter(([, , what]) => HEIGHTS[what]).map(([from, to, what]) => {
    const [y, height] = HEIGHTS[what];
    return svg("rect", { class: what, x: from * WIDE, width: Math.max(what === "fails" || what === "unknown" ? least : 0, (to - from) * WIDE), y, height });
  });
  const line = cursor === null ? null : svg("line", { class: "at", x1: cursor * WIDE, x2: cursor * WIDE, y1: 0, y2: 20 });
  return svg("svg", { class: "strip", viewBox: `0 0 ${WIDE} 20`, preserveAspectRatio: "none", "aria-hidden": "true" }, drawn, line);
}
