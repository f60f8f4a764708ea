// Two sessions beside each other, aligned at their first steps: what came of each property, and what differs first.

import { at, compared } from "./address.js";
import { DelayedHistory, get, items, of } from "./api.js";
import { lasted } from "./episodes.js";
import { h, Place, table } from "./dom.js";
import { strip } from "./strip.js";
import { badge, counted, life, moment, span } from "./words.js";

const BUCKETS = 400;
const MOST = 1000; // episodes of each
const NEAR = 1_000_000_000; // ns: episodes that are no further apart are one and the same
const FEW = 3; // of what was not judged
const LOOKS = { T: "holds", t: "holds", u: "unknown", f: "fails", F: "fails" };

/** The view that compares a session with another one, or asks with which. */
export function compareView(id, other) {
  const body = new Place("section", { class: "compared" });
  const node = h("div", {}, h("h1", {}, other ? `${id} and ${other}` : `Compare ${id} with …`), body.node);
  const history = new DelayedHistory();
  let found = null;

  async function refresh() {
    if (!other) return choose();
    const states = await Promise.all([id, other].map((each) => get(of(each))));
    const news = states.map((each) => [each.status, each.properties.map(({ outcome, violations }) => [outcome, violations]), each.counters.steps, each.revising?.passes, doubtsOf(each), each.remarks]);
    if (found && !history.isDue(JSON.stringify(news))) return;
    const sides = await Promise.all(states.map(sideOf));
    history.wasRead();
    found = sides;
    body.show(sides, () => shown(sides));
  }

  async function choose() {
    const all = (await items("sessions", { brief: true })).filter((each) => each.id !== id);
    const spec = (await get(of(id))).spec;
    all.sort((one, next) => Number(next.spec === spec) - Number(one.spec === spec));
    body.show([all.map((each) => [each.id, each.spec, each.outcome, each.opened]), spec], () => (all.length ? listed(id, all) : h("p", { class: "hint" }, "There is no other session.")));
  }

  return { key: `${id}, compared`, node, refresh };
}

function listed(id, all) {
  return table("sessions", ["session", "spec", "worst outcome", "opened"], all.map((each) => [
    h("a", { href: compared(id, each.id) }, each.id), each.spec, badge(each.outcome ?? "unknown"), moment(each.opened),
  ]));
}

/** One of both sessions: its state, its time, its episodes by property, and its lanes. */
async function sideOf(state) {
  const [whole, episodes] = await Promise.all([get(of(state.id, "timeline"), { buckets: 1, part: "lanes" }), episodesOf(state.id)]);
  const [first, last] = [whole.first ?? 0, whole.last ?? 0];
  const lanes = whole.first === null ? null : await get(of(state.id, "timeline"), { since: first, until: last, buckets: BUCKETS, part: "lanes" });
  return { state, first, begun: whole.first, length: Number(BigInt(last) - BigInt(first)), episodes, lanes };
}

async function episodesOf(id) {
  return items(of(id, "episodes"), { limit: MOST });
}

function shown(sides) {
  const names = [...new Set(sides.flatMap(({ state }) => state.properties.map((each) => each.id)))];
  const most = Math.max(1, ...sides.map((side) => side.length));
  const differing = Object.fromEntries(names.map((name) => [name, firstOf(sides, name)]));
  const first = Object.entries(differing).filter(([, each]) => each).sort(([, one], [, next]) => one.since - next.since)[0];
  const gone = sides.filter(isCut).map(({ state }) => state.id);
  return [
    gone.length ? h("p", { class: "complaint" }, `Not all episodes of ${gone.join(" and ")} are kept any more: what differs in those that are gone is not known.`) : null,
    sides.map(({ state }) => unsure(state)),
    h("p", { class: "first" }, first ? [h("strong", {}, "What differs first: "), sentence(sides, ...first)]
      : [h("strong", {}, gone.length ? "No episode that is kept differs. " : "No episode differs. "), together(sides)]),
    h("div", { class: "sides" }, sides.map((side, i) => headed(side, i))),
    h("p", { class: "hint" }, `Times are from each session's first step; lanes reach to ${span(most)}, the upper one is ${sides[0].state.id}. Episodes that are at most ${span(NEAR)} apart are taken as the same.`,
      sides.some(({ episodes }) => episodes.length === MOST) ? ` Only the first ${MOST} episodes of each are compared.` : ""),
    table("properties compared", ["property", ...sides.map(({ state }) => state.id), "by time", "differs first"], names.map((name) => [
      h("strong", {}, name),
      ...sides.map((side) => told(side, name)),
      h("div", { class: "lanes", title: `${name} by time` }, sides.map((side) => strip(runsOf(side, name, most)))),
      differing[name] ? sentence(sides, name, differing[name], true) : "–",
    ])),
  ];
}

function headed({ state, begun, length }, i) {
  return h("p", {}, i ? "below: " : "above: ", h("a", { href: at(state.id) }, state.id), ` ${life({ ...state, since: state.without_monitor_since })}, judged by `,
    h("a", { href: `#/specs/${encodeURIComponent(state.spec)}` }, state.spec), `, first step ${moment(begun, state.clock)}, ${span(length)} long, ${state.counters.steps ?? "–"} steps`);
}

/** Why what is told of a session may be wrong: what keeps it from being judged, or judged right, and what was not judged. */
function doubtsOf({ status, trouble, properties, doubts }) {
  const caveats = status === "open" ? properties.flatMap((each) => (each.caveats ?? []).map((text) => `${each.id} is degraded: ${text}`)) : [];
  return [...new Set([trouble, ...caveats, ...doubts].filter(Boolean))];
}

function unsure(state) {
  const all = doubtsOf(state);
  const rest = all.length > FEW ? `; and ${all.length - FEW} more` : "";
  return [
    all.length ? h("p", { class: "complaint" }, `${state.id}: ${all.slice(0, FEW).join("; ")}${rest}`) : null,
    (state.remarks ?? []).map((text) => h("p", { class: "hint" }, `${state.id}: ${text}`)),
  ];
}

/** Whether a session had violations that are in none of its episodes: they were deleted with their events. */
function isCut({ state, episodes }) {
  const known = ({ id, order }) => episodes.filter((each) => each.property === id && each.order === order).reduce((sum, each) => sum + each.count, 0);
  return episodes.length < MOST && state.properties.some((each) => each.violations > known(each));
}

/** What came of a property in a session. */
function told({ state, episodes, first, length }, name) {
  const here = state.properties.filter((each) => each.id === name);
  if (!here.length) return h("span", { class: "hint" }, "not in its spec");
  const own = episodes.filter((each) => each.property === name);
  const failing = own.reduce((sum, each) => sum + (each.until === null ? Math.max(0, length - offset(each.began, first)) : lasted(each, null)), 0);
  const all = own.some(({ until }) => until === null) ? "so far" : "in all";
  return here.map((each) => h("div", {}, h("span", { class: "whose" }, `${state.id}: `), badge(each.outcome), here.length > 1 ? ` by ${each.order}` : "",
    h("div", { class: "hint" }, `${some(each.violations, "violation")}, ${some(own.filter(({ order }) => order === each.order).length, "episode")}`,
      own.length ? `, first at ${span(offset(own[0].began, first))}, ${span(failing)} ${all}` : "", each.unknown ? `, ${each.unknown} unknown` : "")));
}

/** The first episode of a property that the other session has no counterpart of; null where each has one. */
export function firstOf(sides, name) {
  const spans = sides.map(({ episodes, first, length }) => episodes.filter((each) => each.property === name).map((each) => ({
    ...each, since: offset(each.began, first), to: each.until === null ? length : offset(each.until, first),
  })));
  const alone = spans.flatMap((own, side) => {
    const other = spans[1 - side];
    return own.filter((each) => !other.some((next) => next.order === each.order && next.since <= each.to + NEAR && each.since <= next.to + NEAR)).map((each) => ({ ...each, side }));
  });
  const known = Math.min(...sides.map(({ episodes, first }) => (episodes.length < MOST ? Infinity : offset(episodes.at(-1).began, first))));
  return alone.filter((each) => each.since <= known).sort((one, next) => one.since - next.since)[0] ?? null;
}

function sentence(sides, name, { side, since, to, first, count: violations, open }, brief = false) {
  const [own, other] = [sides[side], sides[1 - side]];
  const absent = !other.state.properties.some((each) => each.id === name);
  const rest = absent ? "has no such property" : since > other.length ? `was over by then, after ${span(other.length)}` : "has no such episode";
  const link = h("a", { href: at(own.state.id, first) }, `${span(since)} in ${own.state.id}`);
  const lasting = open ? "still open" : `for ${span(to - since)}`;
  if (brief) return [link, `, ${lasting}; ${other.state.id} ${rest}`];
  return [h("strong", {}, name), " fails from ", link, `, ${lasting}, with ${some(violations, "violation")}; ${other.state.id} ${rest}.`];
}

/** Where no episode differs: what else does, as it stands now. */
function together(sides) {
  const unknown = sides.filter(({ state }) => !state.properties.length).map(({ state }) => state.id);
  if (unknown.length) return `How the properties of ${unknown.join(" and ")} stand is not known.`;
  const [one, next] = sides.map(({ state }) => state.properties);
  const key = ({ id, order, outcome }) => JSON.stringify([id, order, outcome]);
  const known = [one, next].map((all) => new Set(all.map(key)));
  const other = [...new Set([...one, ...next].filter((each) => !known.every((all) => all.has(key(each)))).map(({ id }) => id))];
  const [short, long] = [...sides].sort((left, right) => left.length - right.length);
  const rest = long.length - short.length > NEAR ? ` ${short.state.id} is only ${span(short.length)} long, and ${long.state.id} ${span(long.length)}.` : "";
  return [other.length ? `At the end, ${other.join(", ")} stand${other.length > 1 ? "" : "s"} otherwise.` : "All properties stand alike.", rest];
}

function some(number, name) {
  return counted(number || "no", name);
}

function offset(time, first) {
  return Number(BigInt(time) - BigInt(first));
}

function runsOf({ lanes, first }, name, most) {
  if (!lanes || !Object.hasOwn(lanes.lanes, name)) return []; // a property may have the name of what any object has: constructor
  const runs = [];
  const begin = offset(lanes.since, first);
  [...lanes.lanes[name]].forEach((letter, i) => {
    const before = runs.at(-1)?.[2];
    const what = LOOKS[letter] ?? (before === "holds" ? before : null); // what has failed in a bucket may hold at its end
    const [from, to] = [i, i + 1].map((bucket) => Math.min(1, Math.max(0, (begin + bucket * lanes.width) / most)));
    if (!what) return;
    if (runs.at(-1)?.[2] === what) runs.at(-1)[1] = to;
    else runs.push([from, to, what]);
  });
  return runs;
}
