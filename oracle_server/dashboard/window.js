// The part of a session's time that is shown. Times are ns after `origin`, as numbers: exact for a hundred days.

const LEAST = 10e6; // ns
const SHORT = 60; // times as much as an episode is shown of time, at most, but for those that are short
const AROUND = 10e9; // ns, around these
const BEHIND = 0.02; // of the window, between the newest step and the edge where it is live

/** The window on a session's time; `changed` is called when it has moved. */
export class Window {
  #changed;
  #all = false; // all of it is to be shown once it is told how far it reaches

  constructor(changed) {
    this.#changed = changed;
    this.origin = null; // a BigInt: ns
    [this.since, this.until, this.end] = [0, 60e9, 0];
    [this.span, this.live] = [60e9, true];
  }

  /** ns after the origin of a time (ns, number or BigInt). */
  offset(time) {
    return Number(BigInt(time) - this.origin);
  }

  /** The time (ns, BigInt) of an offset. */
  time(offset) {
    return this.origin + BigInt(Math.round(offset));
  }

  /** Tell how far the session reaches (ns, BigInt): from `begin` to `end`. */
  reach(begin, end) {
    this.origin ??= BigInt(begin);
    this.end = Math.max(this.end, this.offset(end));
    if (this.live) this.#set(this.end - this.span, this.end);
    else if (this.#all) this.all();
  }

  /** Show a part of it, which then stands still. */
  show(since, until) {
    this.live = false;
    this.#set(since, until);
  }

  /** Follow the newest steps, with this much of time (ns) in view. */
  follow(span = this.until - this.since) {
    [this.live, this.span] = [true, span];
    this.#set(this.end - span, this.end);
  }

  /** Show so much of time (ns). */
  take(span) {
    this.zoom(span / (this.until - this.since));
  }

  /** Show all of it. */
  all() {
    this.show(0, Math.max(LEAST, this.end));
    this.#all = this.origin === null;
  }

  /** Show an episode, as wide as the window is where that is enough; it stays where the episode is in view. */
  visit({ began, until }) {
    const [from, to] = [this.offset(began), until === null ? this.end : this.offset(until)];
    const span = Math.min(Math.max(this.until - this.since, 1.25 * (to - from)), Math.max(AROUND, SHORT * (to - from)));
    const seen = from >= this.since && to <= this.until && span === this.until - this.since;
    if (!seen) this.show((from + to - span) / 2, (from + to + span) / 2);
  }

  /** Move by a share of what is shown. */
  pan(share) {
    const by = share * (this.until - this.since);
    this.show(this.since + by, this.until + by);
  }

  /** Show `factor` times as much, so that what is at a share (0 to 1) of it stays there. */
  zoom(factor, share = 0.5) {
    const span = this.until - this.since;
    const most = this.origin === null ? Infinity : Math.max(LEAST, 1.2 * this.end);
    const next = Math.min(Math.max(LEAST, span * factor), most);
    if (this.live) return this.follow(next);
    const at = this.since + share * span;
    return this.show(at - share * next, at + (1 - share) * next);
  }

  #set(since, until) {
    const span = Math.max(LEAST, until - since);
    const room = this.live ? BEHIND * span : 0;
    const from = Math.min(Math.max(since, -span / 2), Math.max(0, this.end - span / 2));
    [this.since, this.until, this.#all] = [from + room, from + room + span, false];
    this.#changed();
  }
}

const DAY = 86400e9; // ns
const LONG = 100 * DAY; // from which on labels have years
const STEPS = [1e6, 2e6, 5e6, 1e7, 2e7, 5e7, 1e8, 2e8, 5e8, 1e9, 2e9, 5e9, 10e9, 15e9, 30e9, 60e9, 120e9, 300e9, 600e9,
  1800e9, 3600e9, 7200e9, 21600e9, DAY, 2 * DAY, 5 * DAY, 10 * DAY, 30 * DAY, LONG, 365 * DAY, 3650 * DAY];
const APART = 90; // pixels between two labels

/** The distance of two labels on an axis (ns), where it shows `span` ns on `pixels`. */
export function labelStep(span, pixels) {
  return STEPS.find((step) => (step / span) * pixels >= APART) ?? STEPS.at(-1);
}

/** The text of a time on an axis whose labels are `step` ns apart: seconds for a simulated clock, else the time of day, with its date where there are few a day. */
export function label(time, step, clock) {
  const digits = step >= 1e9 ? 0 : Math.ceil(-Math.log10(step / 1e9));
  if (clock === "sim") return `${(Number(time) / 1e9).toFixed(digits)} s`;
  const date = new Date(Number(time / 1_000_000n));
  if (step >= LONG) return date.toLocaleDateString("sv");
  if (step > 7200e9) return `${date.toLocaleDateString("sv").slice(5)} ${date.toTimeString().slice(0, 5)}`;
  const rest = (time % 1_000_000_000n).toString().padStart(9, "0").slice(0, digits);
  const text = date.toTimeString().slice(0, step >= 60e9 ? 5 : 8);
  return digits ? `${text}.${rest}` : text;
}
