// Paints lanes, streams, signals and decisions on the shared time axis: what holds is thin, what fails is tall.

import { linesOf } from "./bounds.js";
import { label, labelStep } from "./window.js";
import { counted } from "./words.js";

const HOLDS = 3; // pixels high
const SETTLED = 7;
const TALL = 14;
const DENSE = 0.6; // of a block that its violations take, from which on it is one
const ROOM = 96; // pixels that a block's text needs
const DOT = 5; // pixels from one message to the next, from which each is drawn by itself
const GAP = 3; // periods
const LABEL = 13; // pixels high, of a bound
const FEW = 5; // bounds, all of which are lines
const TICK = 10; // pixels, of one of many
const BAR = 5; // pixels that one height stands for, at least

/** Where and how to paint: a canvas as wide as its element, with its context scaled to CSS pixels. */
function pen(canvas, window) {
  const { clientWidth: width, clientHeight: height } = canvas;
  const dense = devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * dense) || canvas.height !== Math.round(height * dense)) {
    [canvas.width, canvas.height] = [Math.round(width * dense), Math.round(height * dense)];
  }
  const context = canvas.getContext("2d");
  context.setTransform(dense, 0, 0, dense, 0, 0);
  context.clearRect(0, 0, width, height);
  const scale = width / (window.until - window.since);
  return { context, width, height, x: (at) => (at - window.since) * scale, scale };
}

let colours = null;
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => (colours = null));

/** The colour of a name in the style sheet. */
export function colour(name) {
  colours ??= new Map();
  if (!colours.has(name)) colours.set(name, resolved(`--${name}`));
  return colours.get(name);
}

function resolved(name) {
  const probe = document.createElement("i");
  probe.style.forcedColorAdjust = "none"; // or all names have one colour, and text is painted on itself
  probe.style.color = `var(${name})`;
  document.body.append(probe);
  const found = getComputedStyle(probe).color;
  probe.remove();
  return found;
}

/** Runs of equal outcomes in a lane: where each begins and ends (offsets), its letter, and the buckets that said it. */
export function runs({ since, width, codes }, until) {
  const found = [];
  let open = null;
  for (let i = 0; i < codes.length; i++) {
    const code = codes[i];
    if (code === " " || code === "-") continue;
    const at = since + i * width;
    if (open?.code === code) open.said.push(at);
    else {
      if (open) found.push({ ...open, to: at });
      open = { from: at, code, said: [at] };
    }
  }
  if (open) found.push({ ...open, to: until });
  return found;
}

/** The outcomes of one property, from its buckets. */
export function paintLane(canvas, window, lane) {
  const at = pen(canvas, window);
  const middle = Math.round(at.height / 2);
  const end = Math.min(window.end, window.until, lane.since + lane.codes.length * lane.width); // beyond nothing is known yet
  for (const run of runs(lane, end)) {
    const from = Math.max(0, at.x(run.from));
    const to = Math.min(at.width, Math.max(at.x(Math.min(run.to, end)), from + 1));
    if (to < 0 || from > at.width) continue;
    if (run.code === "t" || run.code === "T") holds(at, from, to, middle, run.code === "T" ? SETTLED : HOLDS);
    else if (run.code === "u") unknown(at, from, Math.max(to, from + 2), middle);
    else fails(at, run, from, Math.max(to, from + 2), middle, lane);
  }
  dots(at, lane, middle + TALL / 2 - 2);
}

/** Dots under what is degraded: something may have been missed before it. */
function dots({ context, x, width: wide }, { since, width, degraded = "" }, y) {
  context.fillStyle = colour("warn-fill");
  let next = 0;
  for (let i = 0; i < degraded.length; i++) {
    if (degraded[i] !== "1") continue;
    const [from, to] = [x(since + i * width), x(since + (i + 1) * width)];
    for (let at = Math.max(next, from); at < Math.min(to, wide); at += 5) [next] = [at + 5, context.fillRect(at, y, 2, 2)];
  }
}

function holds({ context }, from, to, middle, high) {
  context.fillStyle = colour("holds");
  context.fillRect(from, middle - high / 2, to - from, high);
}

function unknown({ context }, from, to, middle) {
  context.strokeStyle = colour("unknown");
  context.strokeRect(from + 0.5, middle - TALL / 2 + 0.5, Math.max(1, to - from - 1), TALL - 1);
  context.save();
  context.beginPath();
  context.rect(from, middle - TALL / 2, to - from, TALL);
  context.clip();
  context.beginPath();
  for (let x = from - TALL; x < to; x += 5) {
    context.moveTo(x, middle + TALL / 2);
    context.lineTo(x + TALL, middle - TALL / 2);
  }
  context.stroke();
  context.restore();
}

function fails({ context, x, scale }, run, from, to, middle, { since, width, counts }) {
  const wide = Math.max(2, width * scale);
  const dense = run.said.length * wide > DENSE * (x(run.to) - x(run.from)) && to - from > ROOM;
  context.fillStyle = colour(dense ? "fails" : "fails-soft");
  context.fillRect(from, middle - TALL / 2, to - from, TALL);
  context.fillStyle = colour("fails");
  for (const at of run.said) context.fillRect(x(at), middle - TALL / 2, wide, TALL);
  context.fillRect(from, middle - TALL / 2 - 2, to - from, 1.5);
  if (!dense || !counts) return;
  const [first, last] = [run.from, run.to].map((at) => Math.round((at - since) / width));
  const count = counts.slice(first, last).reduce((sum, each) => sum + each, 0);
  if (!count) return;
  context.fillStyle = colour("fails-text");
  context.font = "600 11px Inter, system-ui, sans-serif";
  context.textBaseline = "middle";
  context.fillText(`✗ ${counted(count, "violation")}`, from + 6, middle + 1);
}

/** How often a stream's messages came: each by itself where there is room, else as a height. */
export function paintStream(canvas, window, { since, width, counts, lost }) {
  const at = pen(canvas, window);
  const { context } = at;
  const base = at.height - 3;
  const total = counts.reduce((sum, each) => sum + each, 0);
  const period = total > 1 ? (counts.length * width) / total : Infinity;
  context.fillStyle = colour("quiet-fill");
  context.fillRect(0, base, at.width, 0.75);
  if (period * at.scale > DOT) singles(at, since, width, counts);
  else heights(at, since, width, counts, base);
  context.fillStyle = colour("warn-fill");
  lost.forEach((count, i) => count && context.fillRect(at.x(since + i * width), 0, Math.max(2, width * at.scale), 3));
  for (const [from, to] of gaps(counts, since, width, period)) gap(at, from, to, base);
}

function singles({ context, x, height }, since, width, counts) {
  context.beginPath();
  counts.forEach((count, i) => {
    if (!count) return;
    context.moveTo(x(since + (i + 0.5) * width), height / 2);
    context.arc(x(since + (i + 0.5) * width), height / 2, 2, 0, 7);
  });
  context.fill();
}

/** Counts as heights above a base, together for a few pixels, as they are told to within a bucket; `most` is the highest. */
function heights({ context, x, scale }, since, width, counts, base, most = 0) {
  const together = Math.max(1, Math.ceil(BAR / (width * scale)));
  const sums = Array.from({ length: Math.ceil(counts.length / together) }, (_, i) =>
    counts.slice(i * together, (i + 1) * together).reduce((sum, each) => sum + each, 0));
  const smooth = sums.map((each, i) => (each ? ((sums[i - 1] || each) + 2 * each + (sums[i + 1] || each)) / 4 : 0));
  const highest = Math.max(1, most, ...smooth);
  smooth.forEach((each, i) => {
    if (!each) return;
    const [from, to] = [x(since + i * together * width), x(since + (i + 1) * together * width)];
    const high = Math.max(2, (each / highest) * (base - 3));
    context.fillRect(from, base - high, to - from + 0.5, high);
  });
  return highest;
}

/** Where a stream was silent for more than three of its periods, between two messages (offsets). */
function gaps(counts, since, width, period) {
  const found = [];
  let last = null;
  counts.forEach((count, i) => {
    if (!count) return;
    if (last !== null && (i - last - 1) * width > GAP * period) found.push([since + (last + 1) * width, since + i * width]);
    last = i;
  });
  return found;
}

function gap({ context, x }, since, until, base) {
  const [from, to] = [x(since), x(until)];
  context.strokeStyle = colour("warn-fill");
  context.setLineDash([3, 2]);
  context.strokeRect(from + 0.5, 2.5, to - from - 1, base - 3);
  context.setLineDash([]);
  if (to - from < 34) return;
  context.fillStyle = colour("warn");
  context.font = "600 10.5px Inter, system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(`${((until - since) / 1e9).toFixed(1)} s`, (from + to) / 2, base / 2 + 1);
}

/** A signal's values: from the least to the greatest of each bucket, its mean as a line; and `bounds` as dashed lines, named where there is room. */
export function paintSignal(canvas, window, { since, width, min, max, mean }, bounds, failing) {
  const at = pen(canvas, window);
  const { context } = at;
  const { from, to, lines, above, below } = linesOf(bounds, [...min, ...max].filter((value) => value !== null), failing);
  const room = 6;
  const reaches = to / 2 - from / 2 || 1; // halves: what lies between two finite numbers may be more than the largest one
  const y = (value) => at.height - room - ((value / 2 - from / 2) / reaches) * (at.height - 2 * room);
  context.fillStyle = colour("line-soft");
  min.forEach((value, i) => {
    if (value === null) return;
    const [top, bottom] = [y(max[i]), y(value)];
    context.fillRect(at.x(since + i * width), top, Math.max(1, width * at.scale), Math.max(1, bottom - top));
  });
  stroke(context, mean.map((value, i) => (value === null ? null : [at.x(since + (i + 0.5) * width), y(value)])), colour("accent"));
  context.font = "10.5px Inter, system-ui, sans-serif";
  const names = named(lines, y);
  const few = lines.length <= FEW;
  lines.forEach(({ value }, i) => { // of many those without a name are ticks at the edge, or nothing else could be seen
    context.setLineDash(few || names[i] !== null ? [5, 3] : []);
    stroke(context, [[few || names[i] !== null ? 0 : at.width - TICK, y(value)], [at.width, y(value)]], colour("fails"));
  });
  context.setLineDash([]);
  context.textBaseline = "bottom";
  context.textAlign = "left";
  lines.forEach(({ text }, i) => names[i] !== null && written(context, text, 4, names[i], "bad"));
  const told = lines.filter((_, i) => names[i] !== null).map(({ value }) => value); // a bound's name has its number
  reach(at, from, to, above, below, told);
}

/** Where each line's name stands, null where there is no room for it; the first ones have it before others. */
function named(lines, y) {
  const taken = [];
  return lines.map(({ value }) => {
    const at = y(value) < LABEL + 3 ? y(value) + LABEL : y(value) - 1;
    if (taken.some((other) => Math.abs(at - other) < LABEL - 1)) return null;
    taken.push(at);
    return at;
  });
}

/** Write a text that can be read on lines, too. */
function written(context, text, x, y, ink) {
  context.lineWidth = 3;
  context.strokeStyle = colour("paper");
  context.strokeText(text, x, y);
  context.fillStyle = colour(ink);
  context.fillText(text, x, y);
}

/** What the plot reaches from and to, unless it is `told` there, and how many bounds are beyond. */
function reach({ context, width, height }, from, to, above, below, told) {
  const text = (value, beyond, sign) => [
    ...(beyond ? [`${sign} ${counted(beyond, "more bound")}`] : []),
    ...(told.includes(value) ? [] : [Number(value.toPrecision(4))]),
  ].join(", ");
  context.textAlign = "right";
  context.textBaseline = "top";
  written(context, text(to, above, "↑"), width - TICK - 4, 1, "quiet");
  context.textBaseline = "bottom";
  written(context, text(from, below, "↓"), width - TICK - 4, height - 1, "quiet");
}

function stroke(context, points, style) {
  context.strokeStyle = style;
  context.lineWidth = 1.3;
  context.beginPath();
  let begun = false;
  for (const point of points) {
    if (point === null) continue;
    if (begun) context.lineTo(...point);
    else context.moveTo(...point);
    begun = true;
  }
  context.stroke();
}

/** Decisions by bucket: how many were asked for and denied, and the longest that one was held. */
export function paintDecisions(canvas, window, { since, width, asked, denied, hold }) {
  const at = pen(canvas, window);
  const { context } = at;
  const half = at.height / 2;
  context.fillStyle = colour("quiet-fill");
  const most = heights(at, since, width, asked, half);
  context.fillStyle = colour("deny");
  heights(at, since, width, denied, half, most);
  context.fillStyle = colour("quiet-fill");
  const longest = Math.max(1e6, ...hold);
  hold.forEach((each, i) => {
    const high = (Math.log10(1 + each) / Math.log10(1 + longest)) * (half - 6);
    if (each) context.fillRect(at.x(since + i * width), at.height - 3 - high, Math.max(2, width * at.scale), 2);
  });
}

/** The axis: times, as far apart as they can be read. */
export function paintAxis(canvas, window, clock) {
  const at = pen(canvas, window);
  const { context } = at;
  const step = labelStep(window.until - window.since, at.width);
  context.font = "11px Inter, system-ui, sans-serif";
  context.textBaseline = "middle";
  context.fillStyle = colour("quiet");
  const phase = Number(window.origin % BigInt(step));
  for (let k = Math.ceil((window.since + phase) / step); k * step - phase <= window.until; k++) {
    const offset = k * step - phase;
    context.fillRect(at.x(offset), at.height - 4, 1, 4);
    context.fillText(label(window.time(offset), step, clock), at.x(offset) + 4, at.height / 2);
  }
}

/** The whole session, the worst of all its properties by bucket, with the window on it. */
export function paintOverview(canvas, window, lane) {
  const all = { since: 0, until: Math.max(window.end, 1), end: window.end };
  paintLane(canvas, all, lane);
  const context = canvas.getContext("2d");
  const scale = canvas.clientWidth / all.until;
  const [from, wide] = [window.since * scale, Math.max(3, (window.until - window.since) * scale)];
  context.fillStyle = colour("accent-soft");
  context.globalAlpha = 0.5;
  context.fillRect(from, 0, wide, canvas.clientHeight);
  context.globalAlpha = 1;
  context.strokeStyle = colour("accent");
  context.strokeRect(from + 0.5, 0.5, wide - 1, canvas.clientHeight - 1);
}
