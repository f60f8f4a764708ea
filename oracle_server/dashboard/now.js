// What is wrong now, for how long and since when, as one card an episode: open ones first, then the last that ended.

import { items, of } from "./api.js";
import { at } from "./address.js";
import { h, Place } from "./dom.js";
import { lasted, reasonOf, worstOf } from "./episodes.js";
import { counted, event, moment, span } from "./words.js";

const OPEN = 3; // cards of open episodes; of the others it is said how many they are
const FEW = 3; // of what was not judged
const BAD = ["false", "currently_false"];

/** The cards of a session; `visit` is called with the episode that is chosen, and the click. */
export function nowView(id, visit) {
  const place = new Place("section", { class: "now", "aria-label": "What is wrong now" });
  let records = new Map(); // of the verdicts with which the shown episodes begin

  /** Show how the session stands: `found` are its episodes, and `now` is the time of its newest step, which is `past` where it is of no such time. */
  async function refresh(state, found, now, past) {
    const open = found.filter((each) => each.open);
    const last = found.filter((each) => !each.open).sort(byEnd)[0] ?? null;
    const shown = [...open.slice(0, OPEN), last].filter(Boolean);
    records = new Map([...records].filter(([known]) => shown.some((each) => key(each) === known)));
    await Promise.all(shown.map(learn));
    const { properties, clock, status, live, kind, monitors, trouble, doubts } = state;
    const alone = status === "open" && !live && !trouble && kind !== "recording";
    const known = shown.map((each) => records.get(key(each)) ?? null);
    const standing = properties.map(({ id: name, outcome, broken, caveats, unasked, pending }) => [name, outcome, broken, caveats?.length > 0, Boolean(unasked), pending ?? 0]);
    const troubled = status === "open" && monitors.some(({ attached, streams }) => attached && streams?.some((each) => each.trouble));
    const gone = properties.some(({ violations }) => violations > 0);
    const over = status === "closed";
    const going = status === "open" && kind === "recording";
    place.show([open.slice(0, OPEN), last, open.length, known, standing, troubled, trouble, doubts, clock, alone, going, over, past, gone, String(now)], () => [
      ...open.slice(0, OPEN).map((each) => card(each, clock, now, past)),
      open.length > OPEN ? h("p", { class: "more" }, `+${open.length - OPEN} more that are open`) : null,
      open.length ? null : calm(standing, { troubled, trouble, doubts, alone, going, over }, last || (gone && trouble) ? "" : gone ? " · its violations are kept no more" : " · no episode so far"),
      last ? card(last, clock, now, past) : null,
    ]);
  }

  /** Read the record of the verdict with which an episode begins, once. */
  async function learn(episode) {
    if (records.has(key(episode))) return;
    const [record] = await items(of(id, "verdicts"), { as: "all", after: episode.first - 1, limit: 1 });
    if (record?.n === episode.first) records.set(key(episode), record);
  }

  function card(episode, clock, now, past) {
    const { property, order, first, open, final, began, count, explanation } = episode;
    const record = records.get(key(episode));
    const ended = open ? "" : ` ended ${ago(episode, now, past)}`;
    return h("a", { class: `card ${open ? "open" : "over"}`, href: at(id, first), onclick: (click) => visit(episode, click) },
      h("span", { class: "what" }, h("span", { "aria-hidden": "true" }, open ? "✗ " : "◌ "),
        h("strong", {}, property, open ? (final ? " fails for good" : " fails") : ""), order === "arrival" ? " by arrival" : "", ended),
      h("strong", { class: "long" }, span(lasted(episode, now))),
      h("span", { class: "why" }, [worstOf(episode), counted(count, "violation"), ...firstOf(record)].filter(Boolean).join(" · ")),
      h("span", { class: "since" }, `${open ? "since" : "from"} ${moment(began, clock)}`),
      h("span", { class: "why first", title: explanation }, reasonOf(episode)));
  }

  return { node: place.node, refresh };
}

function key({ property, order, first }) {
  return `${property} ${order} ${first}`;
}

function byEnd(one, other) {
  const apart = BigInt(other.until) - BigInt(one.until);
  return apart > 0n ? 1 : apart < 0n ? -1 : 0;
}

function ago({ until }, now, past) {
  return now === null ? "" : `${span(Math.max(0, Number(BigInt(now) - BigInt(until))))} ${past ? "before the newest step" : "ago"}`;
}

/** Who sent what an episode begins with, and whether it got through. */
function firstOf(record) {
  if (!record) return [];
  const went = { true: "passed on", false: "withheld" }[record.passed];
  return [`first: ${event(record)}`, record.decision === "deny" ? "denied" : null, record.decision ? went : null];
}

/** What is said where no episode is open, and `rest` of those before: that all is well only where all is known to hold. */
function calm(standing, { troubled, trouble, doubts, alone, going, over }, rest) {
  if (!standing.length) return h("p", { class: "card calm unsure", "data-state": "not judged" }, h("strong", {}, "How its properties stand is not known"));
  const of = (wanted) => standing.filter(([, outcome]) => wanted(outcome)).map(([name]) => name);
  const [failing, unknown] = [of((outcome) => BAD.includes(outcome)), of((outcome) => outcome === "unknown")];
  const degraded = standing.filter(([, , , is]) => is).map(([name]) => name);
  const unasked = [...new Set(standing.filter(([, , , , is]) => is).map(([name]) => name))];
  const waits = over || alone ? standing.filter(([, , , , , pending]) => pending) : []; // what must follow will hardly come any more
  const holding = standing.length - failing.length - unknown.length;
  const [state, mood] = failing.length ? ["do not hold", "bad"] : unknown.length ? ["not judged", "unsure"] : degraded.length || troubled || doubts.length ? ["degraded", "unsure"] : trouble ? ["not known", "unsure"] : alone ? ["not watched", "unsure"] : going ? ["being judged", "unsure"] : waits.length ? ["undecided", "unsure"] : ["hold", "good"];
  const few = (names) => `${names.slice(0, 3).join(", ")}${names.length > 3 ? " …" : ""}`;
  const words = [
    failing.length ? `${failing.length} of ${standing.length} fail: ${few(failing)}` : null,
    unknown.length ? `${unknown.length} of ${standing.length} not judged: ${few(unknown)}` : null,
    !failing.length && !unknown.length ? `${holding === 1 ? "Its property" : `All ${holding} properties`} ${alone ? "held at the newest step" : `${holding === 1 ? "holds" : "hold"}${over ? " at the end" : going ? " so far" : ""}`}` : null,
    going ? "the recording is not judged to its end yet" : null,
    unasked.length ? `nothing was asked of ${few(unasked)}` : null,
    waits.length ? `${counted(waits.reduce((sum, [, , , , , pending]) => sum + pending, 0), "obligation")} still open: ${few(waits.map(([name]) => name))}` : null,
    alone ? "no monitor is there now" : null,
    degraded.length ? `${degraded.length} of ${standing.length} degraded: ${few(degraded)}` : null,
    troubled ? "not all streams are heard as they should be" : null,
    ...doubts.slice(0, FEW),
    doubts.length > FEW ? `and ${doubts.length - FEW} more that was not judged` : null,
  ];
  const known = trouble ? " as far as is known" : ""; // what keeps it from being judged stands above
  return h("p", { class: `card calm ${mood}`, "data-state": state },
    h("strong", {}, words.filter(Boolean).join("; "), known), rest ? h("span", { class: "hint" }, rest) : null);
}
