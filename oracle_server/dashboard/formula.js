// A property's formula as a tree, with what each part came to at the steps around a verdict.

import { at } from "./address.js";
import { get, of, Problem } from "./api.js";
import { h, Place, rove, TO_AND_FRO } from "./dom.js";
import { strip } from "./strip.js";
import { place, span } from "./words.js";

const WITHIN = 600_000; // ms, as for an explanation: the session is judged again
const SPANS = [["100 ms", 100_000_000], ["1 s", 1_000_000_000], ["10 s", 10_000_000_000]];
const STEPS = 200; // on each side
const SLOW = 1000; // ms
const SAID = { holds: "✓ holds", fails: "✗ fails", unknown: "? unknown", not_told: "–" };

/** The tree of the formula of the verdict that is shown. */
export function formulaView(id) {
  const tree = new Place("div");
  const node = h("section", { class: "formula", "aria-label": "Formula by time" }, tree.node);
  const settle = rove(tree.node, ".caption button", TO_AND_FRO);
  let [shown, answer, cursor, within, clock, leaving] = [null, null, 0, SPANS[1][1], "wall", new AbortController()];

  /** Show the formula of a record's verdict; nothing without one. */
  function show(record, itsClock) {
    clock = itsClock;
    const key = record ? `${record.n} ${record.outcome}` : null;
    if (key === shown) return;
    shown = key;
    ask(record?.n);
  }

  async function ask(n) {
    leaving.abort();
    leaving = new AbortController();
    const mine = leaving;
    if (!n) return draw(null);
    const slow = setTimeout(() => mine === leaving && draw({ refusal: "it is being computed, for which the session is judged again." }), SLOW);
    try {
      const found = await get(of(id, `verdicts/${n}/parts`), { within, steps: STEPS }, { within: WITHIN, signal: mine.signal });
      if (mine !== leaving) return;
      cursor = found.at;
      draw(found);
    } catch (problem) {
      if (mine !== leaving) return;
      if (problem instanceof Problem && [0, 502, 503].includes(problem.status)) shown = null; // asked again with the next refresh
      draw({ refusal: problem instanceof Problem ? problem.message : "it could not be read." });
    } finally {
      clearTimeout(slow);
    }
  }

  function draw(found) {
    answer = found;
    const focused = tree.node.contains(document.activeElement) && document.activeElement.dataset.role;
    tree.show([answer, cursor, within, clock], () => (answer ? drawn() : []));
    settle();
    if (focused) tree.node.querySelector(`[data-role="${focused}"]`)?.focus();
  }

  function move(to) {
    cursor = Math.max(0, Math.min(answer.times.length - 1, to));
    draw(answer);
  }

  function zoom(wanted) {
    within = wanted;
    ask(answer.n);
  }

  function drawn() {
    if (answer.refusal) return h("p", { class: "hint" }, `The formula by time: ${answer.refusal}`);
    const steps = stepsOf(answer);
    const looks = looksOf(answer);
    const causes = causesOf(answer.parts, looks.map((each) => valueAt(each, cursor)));
    return [
      h("p", { class: "tools caption" }, h("strong", {}, "Formula by time"),
        h("span", { class: "joint end" }, SPANS.map(([text, wanted]) => h("button", {
          "data-role": text, "aria-pressed": String(within === wanted), onclick: () => zoom(wanted),
        }, `±${text}`)))),
      h("table", { class: "parts", "aria-label": "parts of the formula" },
        h("thead", {}, h("tr", {}, ["part", "at the step", "by time"].map((head) => h("th", { scope: "col" }, head)))),
        h("tbody", {}, answer.parts.map((part, i) => row(part, steps, looks[i], causes.has(i))))),
      slider(steps),
      answer.note ? h("p", { class: "hint" }, answer.note) : null,
      answer.earlier || answer.later ? h("p", { class: "hint" }, `The ${answer.times.length} steps nearest to it; there are more within this time.`) : null,
    ];
  }

  function row(part, steps, looks, cause) {
    const value = valueAt(part.runs, cursor);
    const look = valueAt(looks, cursor);
    const text = part.name ? `${part.name}: ${part.text}` : part.text;
    return h("tr", { class: `${value} ${look === value ? "decides" : "moot"}${cause ? " cause" : ""}` },
      h("th", { scope: "row", title: text, class: `depth${Math.min(part.depth, 12)}` },
        part.name ? h("b", {}, `${part.name} `) : null, h("code", {}, part.head), part.more ? " …" : null),
      h("td", { title: why(part, value) }, signal(part) ?? said(part, value)),
      h("td", {}, strip(runsOf(looks, steps), steps.shares[cursor])));
  }

  /** The value of an atom's signal, with a word for readers who do not see the sign before the part. */
  function signal(part) {
    const [value, truth] = [part.values.length ? valueAt(part.values, cursor) : null, valueAt(part.runs, cursor)];
    if (value === null || value === undefined) return null;
    return [h("span", { class: "unseen" }, `${said(part, truth)}, `), `${part.signal} = ${typeof value === "string" ? JSON.stringify(value) : value}`];
  }

  /** What moves the step at which the tree is shown: by arrow keys, and by pointing at a time. */
  function slider(steps) {
    const number = answer.numbers[cursor];
    const where = `${place(answer.steps[cursor], answer.times[cursor], clock)}, ${SAID[valueAt(answer.parts[0].runs, cursor)]}`;
    const keys = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10, Home: -Infinity, End: Infinity };
    const pressed = (event) => {
      const by = keys[event.key];
      if (by === undefined) return;
      event.preventDefault();
      event.stopPropagation();
      move(cursor + by);
    };
    const pointed = (event) => {
      const box = event.currentTarget.getBoundingClientRect();
      move(nearest(steps.shares, (event.clientX - box.left) / box.width));
    };
    return h("div", { class: "steps" },
      h("button", { "data-role": "back", "aria-label": "The step before", disabled: cursor === 0, onclick: () => move(cursor - 1) }, "‹"),
      h("button", { "data-role": "on", "aria-label": "The next step", disabled: cursor === answer.times.length - 1, onclick: () => move(cursor + 1) }, "›"),
      h("span", { class: "where" }, where, number === answer.n ? " (this verdict)" : [" ", h("a", { href: at(id, number) }, "explain")]),
      h("div", {
        class: "track", role: "slider", tabindex: 0, "data-role": "track", "aria-label": "Step", "aria-valuemin": 1, "aria-valuemax": answer.times.length,
        "aria-valuenow": cursor + 1, "aria-valuetext": where, onkeydown: pressed, onpointerdown: pointed,
      }, strip([], steps.shares[cursor]), h("span", {}, distance(steps, 0)), h("span", {}, distance(steps, answer.times.length - 1))));
  }

  function distance(steps, i) {
    const apart = steps.offsets[i] - steps.offsets[answer.at];
    return `${apart < 0 ? "−" : "+"}${span(Math.abs(apart))}`;
  }

  return { node, show, leave: () => leaving.abort() };
}

/** Where the steps are by time: their offsets (ns) and shares of the whole; one that came late is where it was judged. */
function stepsOf({ times }) {
  const offsets = [];
  for (const time of times) offsets.push(Math.max(Number(BigInt(time) - BigInt(times[0])), offsets.at(-1) ?? 0));
  const whole = offsets.at(-1) || 1;
  return { offsets, shares: offsets.map((offset) => 0.01 + 0.97 * (offset / whole)) };
}

function runsOf(runs, { shares }) {
  return runs.map(([from, what], i) => [shares[from], i + 1 < runs.length ? shares[runs[i + 1][0]] : 1, what]);
}

function valueAt(runs, index) {
  return runs.findLast(([from]) => from <= index)[1];
}

function nearest(shares, wanted) {
  return shares.reduce((best, share, i) => (Math.abs(share - wanted) < Math.abs(shares[best] - wanted) ? i : best), 0);
}

function said(part, value) {
  if (value !== "not_told") return SAID[value];
  if (part.needs.length) return `for each ${part.needs.join(", ")}`;
  return part.waits ? "awaited" : SAID.not_told;
}

function why(part, value) {
  if (value !== "not_told") return null;
  if (part.needs.length) return "It is true or false for each value by itself.";
  return part.waits ? "It is decided by what comes." : "It can't be told here: the outcome was final before, or judging again comes out otherwise.";
}

/** How each part looks by time: as it was where it decides the whole, `moot` where it holds and `no` where it fails without need. */
function looksOf({ parts, times }) {
  const below = parts.map((_, i) => childrenOf(parts, i));
  const looks = parts.map(() => []);
  const changes = new Set(parts.flatMap(({ runs }) => runs.map(([from]) => from)));
  for (let step = 0; step < times.length; step++) {
    if (!changes.has(step)) continue;
    const values = parts.map(({ runs }) => valueAt(runs, step));
    const deciding = decidingOf(parts, below, values);
    values.forEach((value, i) => {
      const needed = deciding.has(i) && !(value === "fails" && values[0] !== "fails");
      const look = needed ? value : { holds: "moot", fails: "no" }[value] ?? value;
      if (looks[i].at(-1)?.[1] !== look) looks[i].push([step, look]);
    });
  }
  return looks;
}

/** The parts, by their places, that decide the whole where they have these values. */
function decidingOf(parts, below, values) {
  const found = new Set();
  const visit = (i) => {
    found.add(i);
    const all = (wanted) => below[i].filter((each) => values[each] === wanted);
    const { head } = parts[i];
    let next = below[i];
    if (head === "and" && values[i] === "fails") next = all("fails");
    else if (head === "or" && values[i] === "holds") next = all("holds");
    else if (head === "->" && values[i] === "holds") next = below[i].filter((each, place) => values[each] === (place ? "holds" : "fails"));
    else if (/^(pre|once|historically|since|lasting)/.test(head)) next = all(values[i]); // of what held before, where it is as the whole of it
    next.forEach(visit);
  };
  visit(0);
  return found;
}

/** The places of the parts that fail, and have no part of which that is said. */
function causesOf(parts, looks) {
  const failing = looks.flatMap((look, i) => (look === "fails" ? [i] : []));
  return new Set(failing.filter((i) => i && !childrenOf(parts, i).some((each) => looks[each] === "fails")));
}

function childrenOf(parts, i) {
  const below = [];
  for (let at = i + 1; at < parts.length && parts[at].depth > parts[i].depth; at++) if (parts[at].depth === parts[i].depth + 1) below.push(at);
  return below;
}
