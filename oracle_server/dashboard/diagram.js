// The events around a moment as a sequence diagram: who sent what, what was decided of it, and when.

import { at } from "./address.js";
import { get, of, Problem } from "./api.js";
import { h, rove, svg, TO_AND_FRO } from "./dom.js";
import { offset, rowsOf, sentence } from "./lifelines.js";
import { counted, moment, ordered } from "./words.js";

const LIMIT = 16;
const [TIMES, APART, EDGE] = [48, 64, 36]; // pixels: for times, between lifelines, and beside the outer ones
const [HEAD, ROW, GAP] = [40, 30, 14];
const CHARACTER = 6.1;
const WIDEST = 250; // pixels of a label

/** The diagram around the verdict that is shown. */
export function diagramView(id) {
  const body = h("div", { class: "scroll", tabindex: -1 });
  const head = h("p", { class: "tools caption" });
  const settle = rove(head, "button:enabled", TO_AND_FRO);
  const node = h("section", { class: "sequence", "aria-label": "Sequence", hidden: true }, head, body);
  let [shown, record, answer, all, clock, mine, row] = [null, null, null, false, "wall", 0, 0];
  let focused = false; // where the focus was in it when it was hidden
  const resized = new ResizeObserver(() => draw(stops().findIndex(isStop)));
  resized.observe(body);

  /** Show what was around a record; nothing without one. */
  function show(next, itsClock) {
    clock = itsClock;
    if ((next?.n ?? null) === shown) return;
    [shown, record] = [next?.n ?? null, next];
    ask({ n: shown });
  }

  async function ask(place) {
    const number = ++mine;
    if (!shown || !record?.property) return fill(null);
    try {
      const found = await get(of(id, "sequence"), { ...place, limit: LIMIT, property: record.property, others: all });
      if (number === mine) fill(found, place.n);
    } catch (problem) {
      if (number !== mine) return;
      if (!(problem instanceof Problem) || ![404, 410].includes(problem.status)) shown = null; // asked again with the next refresh
      fill(null);
    }
  }

  function fill(found, chosen) {
    const { activeElement: active } = document;
    if (node.contains(active)) focused = active.dataset.role ?? "row";
    else if (active !== document.body) focused = false; // somewhere else by now
    answer = found;
    node.hidden = !found;
    if (!found) return;
    row = chosen ? Math.max(0, found.items.findIndex(({ n }) => n === chosen)) : 0;
    head.replaceChildren(...captioned());
    settle();
    draw();
    if (focused) (node.querySelector(`[data-role="${focused}"]`) ?? node.querySelector('a[tabindex="0"]'))?.focus({ preventScroll: true });
    focused = false;
  }

  function captioned() {
    const { items, left_out: out, earlier, later } = answer;
    const more = out ? `, ${out} more do not concern ${record.property}` : "";
    const go = (name, text, place) => h("button", { "data-role": name, disabled: place === null, onclick: () => ask({ [name]: place }) }, text);
    return [
      h("strong", {}, "Sequence"), h("span", { class: "hint" }, `${counted(items.length, "event")}${more}`),
      h("span", { class: "end" },
        h("button", { "data-role": "all", "aria-pressed": String(all), onclick: () => {
          all = !all;
          ask({ n: shown });
        } }, "All streams"),
        h("span", { class: "joint" }, go("before", "Earlier", earlier), go("n", "Here", shown), go("after", "Later", later))),
    ];
  }

  const stops = () => [...body.querySelectorAll("a")];
  const isStop = (link) => link.getAttribute("tabindex") === "0";

  /** Draw what was answered; `kept` is the row that the Tab key goes on stopping at, -1 for the verdict's. */
  function draw(kept = -1) {
    if (!answer || !body.clientWidth) return;
    const focused = body.contains(document.activeElement);
    const drawn = drawing(answer.items, BigInt(ordered(record)), body.clientWidth);
    body.replaceChildren(answer.items.length ? drawn : h("p", { class: "hint" }, "Nothing that concerns it is near."));
    if (kept >= 0) stops().forEach((link, i) => link.setAttribute("tabindex", i === kept ? 0 : -1));
    if (focused) stops().find(isStop)?.focus({ preventScroll: true });
  }

  function drawing(items, origin, room) {
    const { rows, lifelines, calls } = rowsOf(items, origin);
    const apart = Math.max(APART, (room - TIMES - 2 * EDGE) / Math.max(1, lifelines.length - 1));
    const width = Math.max(room, TIMES + 2 * EDGE + apart * Math.max(0, lifelines.length - 1));
    const x = Object.fromEntries(lifelines.map(({ key }, i) => [key, TIMES + EDGE + i * apart]));
    let below = HEAD;
    const y = rows.map((each) => (below += ROW + (each.gap ? GAP : 0)) - 8);
    const height = below + 12;
    const first = Math.max(0, rows.findIndex(({ item }) => item === items[row]));
    return svg("svg", { class: "diagram", width, height, viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": `Events by time, ms from ${moment(ordered(record), clock)}; arrow keys go from one to the next` },
      lifelines.map((each) => lifeline(each, x[each.key], height, apart)),
      calls.map(({ stream, from, to }, i) => x[stream] && svg("rect", { class: "call", x: x[stream] - 3 + 3 * (i % 2), y: y[from], width: 6, height: Math.max(4, y[to] - y[from]) })).filter(Boolean),
      holds(rows, x, y),
      rows.map((each, i) => drawnRow(each, x, y[i], width, i === first)));
  }

  function drawnRow(each, x, y, width, isFirst) {
    const { item, what, gap } = each;
    const chosen = item.n === shown;
    const classes = ["event", what, item.violated.length && what !== "allowed" && "violated", item.late && "late", chosen && "here"].filter(Boolean).join(" ");
    const node = svg("a", { class: classes, href: at(id, item.n), tabindex: isFirst ? 0 : -1, "aria-label": sentence(each), "aria-current": chosen ? "true" : null },
      svg("title", {}, `${sentence(each)}\n${moment(item.stamp, clock)}`),
      svg("rect", { class: "hit", x: 0, y: y - ROW + 10, width, height: ROW }),
      svg("text", { class: "when", x: 4, y: y + 4 }, offset(each.at)),
      what === "deadline" ? deadline(each, y, width) : arrow(each, x, y, width));
    return [gap ? svg("g", { class: "gap" }, svg("line", { x1: TIMES, x2: width, y1: y - ROW + 3, y2: y - ROW + 3 }), svg("text", { x: 4, y: y - ROW + 7 }, gap)) : null, node];
  }

  body.addEventListener("keydown", (pressed) => {
    const by = { ArrowUp: -1, ArrowDown: 1, Home: -Infinity, End: Infinity }[pressed.key];
    const links = stops();
    const from = links.indexOf(document.activeElement);
    if (by === undefined || from < 0) return;
    pressed.preventDefault();
    pressed.stopPropagation();
    const to = links[Math.max(0, Math.min(links.length - 1, from + by))];
    links[from].setAttribute("tabindex", "-1");
    to.setAttribute("tabindex", "0");
    to.focus();
  });

  return { node, show, leave: () => {
    mine++;
    resized.disconnect();
  } };
}

function lifeline({ key, name, hint }, x, height, apart) {
  const most = Math.floor(apart / CHARACTER);
  return svg("g", { class: `lifeline ${key.split(" ")[0]}` },
    svg("title", {}, `${name}: ${hint}`),
    svg("text", { x, y: 14 }, within(name, most)), svg("text", { class: "hint", x, y: 28 }, cut(hint, most)),
    svg("line", { x1: x, x2: x, y1: 34, y2: height }));
}

/** How long each event waited at its monitor: from where it came to where it was decided. */
function holds(rows, x, y) {
  return rows.map((row, i) => {
    const decided = row.what === "message" && row.item.asked ? rows.findIndex((other) => other.item === row.item && other !== row) : -1;
    return decided < 0 ? null : svg("rect", { class: "held", x: x[row.via.key] - 3, y: y[i], width: 6, height: Math.max(3, y[decided] - y[i]) });
  });
}

function arrow({ what, from, to, via, label }, x, y, width) {
  const [begin, goal] = [x[from.key], x[to.key]];
  const stopped = what === "denied";
  const end = stopped ? begin + 0.7 * (goal - begin || APART) : goal;
  const way = Math.sign(end - begin) || 1;
  const seen = via && x[via.key] !== goal && x[via.key] !== begin ? svg("circle", { cx: x[via.key], cy: y, r: 3 }) : null;
  const size = Math.min(label.length * CHARACTER, WIDEST);
  const middle = Math.min(Math.max((begin + end) / 2, TIMES + size / 2), Math.max(TIMES + size / 2, width - size / 2 - 4));
  return [
    svg("line", { class: "way", x1: begin, x2: end - way * (stopped ? 6 : 1), y1: y, y2: y }),
    stopped ? [svg("circle", { class: "stop", cx: end, cy: y, r: 6 }), svg("line", { class: "stop", x1: end - 4, y1: y + 4, x2: end + 4, y2: y - 4 })]
      : svg("path", { class: "tip", d: `M${end} ${y}l${-7 * way} -3.5v7z` }),
    seen,
    svg("text", { class: "label", x: middle, y: y - 5 }, cut(label, Math.floor(WIDEST / CHARACTER))),
  ];
}

function deadline({ label }, y, width) {
  return [
    svg("line", { class: "way", x1: TIMES, x2: width, y1: y, y2: y }),
    svg("text", { class: "label", x: (TIMES + width) / 2, y: y - 5 }, cut(label, Math.floor((width - TIMES) / CHARACTER))),
  ];
}

/** A name cut in its middle: long ones often differ at their ends. */
function within(name, most) {
  const tail = Math.ceil((2 * most) / 3);
  return name.length > most ? `${name.slice(0, Math.max(1, most - tail - 1))}…${name.slice(-tail)}` : name;
}

function cut(text, most) {
  return text.length > most ? `${text.slice(0, Math.max(1, most - 1))}…` : text;
}
