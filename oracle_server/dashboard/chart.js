// The chart of a session's steps: the event and the outcome of every property, one column a step.

import { at } from "./address.js";
import { DelayedHistory, items, of } from "./api.js";
import { h, Place } from "./dom.js";
import { event, mark, stream } from "./words.js";

const STEPS = 60;
const BEFORE = 0.5; // the share of the steps that are shown before the chosen one
const MOST = 1000; // records in one answer
const LONG = 18; // characters of a name, from which on it may need several lines

/** A view of the newest steps, or of those around verdict `n`; `witness` marks the steps that explain it. */
export function chartView(id, n) {
  const picture = new Place("section", { class: "chart" });
  const history = new DelayedHistory();
  let [order, records, said, witnesses, moved] = [null, [], {}, [], true];

  async function refresh(state) {
    const orders = [...new Set(state.properties.map((each) => each.order))];
    const properties = [...new Set(state.properties.map((each) => each.id))];
    if (history.isDue(JSON.stringify([n, state.trouble, state.counters, state.revising?.passes, state.properties.map((each) => each.outcome)]))) {
      const requested = n;
      const found = await around(id, requested, properties.length);
      history.wasRead();
      const first = found.some((each) => each.revised) ? await around(id, requested, properties.length, "first") : [];
      if (requested !== n) return; // another verdict was chosen meanwhile, which has its own request
      records = found;
      said = Object.fromEntries(first.map((each) => [each.n, each.outcome]));
    }
    if (moved) order = records.find((each) => each.n === n)?.order ?? order ?? orders[0];
    draw({ id, n, orders, properties });
  }

  function draw(by) {
    const columns = columnsOf(records, by.properties.length, said).filter((each) => each.order === order);
    const scrolled = scrolledBack(picture.node.firstChild);
    const focused = picture.node.contains(document.activeElement) && document.activeElement.getAttribute("href");
    const changed = picture.show({ ...by, order, witnesses, columns }, (shown) => drawn(shown, (other) => {
      order = other;
      draw(by);
    }));
    if (changed && focused) focusOn([...picture.node.querySelectorAll("td > a")].find((each) => each.getAttribute("href") === focused));
    if (!by.n && changed && !scrolled) picture.node.firstChild.scrollLeft = Number.MAX_SAFE_INTEGER;
    const chosen = by.n && moved && picture.node.querySelector(".chosen");
    if (chosen) centre(picture.node.firstChild, chosen);
    moved = by.n && moved && !chosen;
  }

  return {
    node: picture.node,
    refresh,
    goTo: (other) => ([n, witnesses, moved] = [other, [], true]),
    witness: (steps) => (witnesses = steps),
  };
}

/** The records of the newest steps, or of those around one, as they stand or were said at first; `width` is how many properties there are. */
async function around(id, n, width, as = "standing") {
  if (!width) return []; // nothing of the session is judged
  const steps = Math.max(1, Math.min(STEPS, Math.floor(MOST / width)));
  const limit = Math.min(MOST, steps * width);
  if (!n) return (await items(of(id, "verdicts"), { as, order: "desc", limit })).reverse();
  const before = Math.max(0, Math.ceil(n / width) - 1 - Math.floor(steps * BEFORE));
  return items(of(id, "verdicts"), { as, after: before * width, limit });
}

/** Scroll a box to where something in it is, and the page not at all. */
function centre(box, inside) {
  const [outer, inner] = [box, inside].map((each) => each.getBoundingClientRect());
  box.scrollLeft += inner.left + inner.width / 2 - outer.left - outer.width / 2;
}

function scrolledBack(box) {
  return box?.scrollWidth && box.scrollLeft + box.clientWidth < box.scrollWidth - 8;
}

/** The records grouped by step; `said` is what was said at first of those that were revised, by their numbers. */
function columnsOf(records, width, said) {
  const columns = new Map();
  for (const record of records) {
    const position = Math.ceil(record.n / width);
    if (!columns.has(position)) columns.set(position, { ...record, outcomes: {} });
    const { n, outcome, violation, revised } = record;
    columns.get(position).outcomes[record.property] = { n, outcome, violation, said: revised ? said[n] ?? "something else" : null };
  }
  return [...columns.values()];
}

function drawn({ id, n, order, orders, properties, witnesses, columns }, choose) {
  if (!columns.length) {
    return n ? [h("p", { class: "hint" }, `There are no steps around verdict ${n}.`), h("p", { class: "tools" }, moves(id, n, columns))]
      : h("p", { class: "hint" }, properties.length ? "Nothing was judged yet." : "Which properties it judges is not known, so that its steps are not shown.");
  }
  const explains = (each) => witnesses.includes(each.step) && "witness";
  const row = (name, cells) => h("tr", {}, h("th", { scope: "row", class: name.length > LONG && "long", title: name }, name), cells);
  const head = columns.map((each) => h("th", { scope: "col", class: explains(each) }, number(each)));
  const lanes = [...new Set(columns.map(lane))].sort();
  const events = lanes.map((name) => row(name, columns.map((each) =>
    lane(each) === name ? h("td", { class: explains(each), title: title(each) }, sign(each)) : h("td"))));
  const outcomes = properties.map((name) => row(name, columns.map((each) => h("td", {}, cell(id, n, name, each)))));
  const cells = outcomes.flatMap((each) => [...each.querySelectorAll("a")]);
  const first = cells.find((each) => each.classList.contains("chosen")) ?? outcomes[0]?.querySelector("td:last-child > a") ?? cells[0];
  for (const each of cells) each.tabIndex = each === first ? 0 : -1; // one stop; arrow keys go on from there
  return [
    h("div", { class: "scroll", onkeydown: moveFocus },
      h("table", { "aria-label": "steps; arrow keys go from verdict to verdict" }, h("thead", {}, h("tr", {}, h("th", {}, "step"), head)), h("tbody", {}, events, outcomes))),
    h("p", { class: "tools" }, n ? moves(id, n, columns) : newest(),
      orders.length < 2 ? null : orders.map((each) =>
        h("button", { "aria-pressed": String(each === order), onclick: () => choose(each) }, `by ${each}`))),
  ];
}

const ARROWS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };

/** Go from a verdict to the next one in the direction of an arrow key. */
function moveFocus(pressed) {
  const [down, right] = ARROWS[pressed.key] ?? [];
  const from = pressed.target.closest("td");
  if (down === undefined || !from) return;
  pressed.preventDefault();
  const body = from.closest("tbody");
  let [y, x] = [[...body.rows].indexOf(from.parentNode), from.cellIndex];
  for (;;) {
    [y, x] = [y + down, x + right];
    const to = body.rows[y]?.cells[x];
    if (!to) return;
    if (to.firstChild instanceof HTMLAnchorElement) return focusOn(to.firstChild);
  }
}

/** Move the focus to a verdict, and the one stop of the Tab key with it. */
function focusOn(link) {
  if (!link) return;
  for (const each of link.closest("tbody").querySelectorAll("a[tabindex='0']")) each.tabIndex = -1;
  link.tabIndex = 0;
  link.focus();
}

function newest() {
  return h("span", { class: "hint" }, "The newest steps. Choose a verdict to see its explanation.");
}

function moves(id, n, columns) {
  const outcomes = columns.flatMap((each) => Object.entries(each.outcomes));
  const property = outcomes.find(([, outcome]) => outcome.n === n)?.[0];
  const [first, last] = [columns[0], columns.at(-1)].map((each) => each?.outcomes[property]?.n ?? n);
  return [
    first < n && h("a", { href: at(id, first) }, "← Earlier"),
    last > n && h("a", { href: at(id, last) }, "Later →"),
    h("a", { href: at(id) }, "Follow the newest steps"),
  ].filter(Boolean);
}

function lane(of) {
  if (of.kind === "tick") return "deadlines";
  return `${stream(of.stream, of.kind)} (${of.monitor})`;
}

function number({ step }) {
  return step !== null && step % 5 === 0 ? String(step) : "";
}

function sign({ decision, late }) {
  if (decision === "deny") return "⊘";
  return late ? "◌" : "●";
}

function title(of) {
  const marks = ["late", "skewed", "degraded"].filter((each) => of[each]);
  return [`step ${of.step ?? "–"}: ${event(of)}`, of.decision && `decided: ${of.decision}`, ...marks].filter(Boolean).join(", ");
}

function cell(id, n, property, of) {
  const verdict = of.outcomes[property];
  if (!verdict) return "";
  const { outcome, said } = verdict;
  const classes = [outcome, verdict.violation && "violation", said && "revised", verdict.n === n && "chosen"].filter(Boolean).join(" ");
  const label = `${property} at step ${of.step ?? "–"}: ${outcome}${said ? `, revised; said at first: ${said}` : ""}`;
  return h("a", { class: classes, href: at(id, verdict.n), title: label, "aria-label": label }, mark(outcome));
}
