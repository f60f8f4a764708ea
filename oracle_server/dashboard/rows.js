// The rows of the timeline as elements: one stop of the Tab key, from which arrow keys go; what holds is folded.

import { h, named, Place } from "./dom.js";

const MANY = 8; // properties, from which on those that hold are folded

/** The rows below the axis; `explain(row)` is called for the row on which Enter is pressed, `changed()` once they are folded. */
export function rowsView(explain, changed) {
  const body = new Place("div", { class: "rows" });
  let [shown, order, folded] = [[], [], true];
  body.node.addEventListener("keydown", moveFocus);

  /** Show rows; those of properties that hold in all that is in view become one, where there are many. */
  function show(rows) {
    const still = body.node.matches(":hover, :focus-within");
    const found = arranged(rows, still ? order : []);
    order = found.map(({ key }) => key);
    shown = withFolded(found);
    const focused = body.node.contains(document.activeElement) ? document.activeElement.dataset.row : null;
    body.show(shown.map(({ key, title, expanded }) => [key, title, expanded]), () => shown.map(element));
    shown.forEach((row, i) => {
      const [label, canvas, value] = body.node.children[i].children;
      row.canvas = canvas;
      if (value.textContent !== row.value) value.textContent = value.title = row.value;
      value.className = `value ${row.mood ?? ""}`;
      const said = [row.said ?? row.title, row.value].filter(Boolean).join("; ");
      if (label.firstChild.getAttribute("aria-label") !== said) label.firstChild.setAttribute("aria-label", said);
    });
    if (focused) body.node.querySelector(`[data-row="${CSS.escape(focused)}"]`)?.focus();
  }

  function withFolded(rows) {
    const holding = rows.filter(({ holds }) => holds);
    const properties = rows.filter(({ group }) => group === "property");
    if (properties.length <= MANY || holding.length < 2) return rows;
    const row = {
      ...holding[0].together(holding), group: "property fold", key: "fold", expanded: !folded,
      act: () => { folded = !folded; changed(); },
    };
    const rest = properties.filter((each) => !holding.includes(each));
    return [...rest, row, ...(folded ? [] : holding), ...rows.filter(({ group }) => group !== "property")];
  }

  function element(row) {
    const { group, key, name, title, tall, expanded, act } = row;
    const canvas = h("canvas", { "aria-hidden": "true", class: tall ? "tall" : "" });
    const button = h("button", {
      title, tabindex: -1, "data-row": key, "aria-expanded": expanded === undefined ? null : String(expanded),
      onclick: act ?? (() => explain(shown.find((each) => each.key === key))),
    }, named(name));
    return lane(button, canvas, group);
  }

  /** The row on whose canvas something happened. */
  function at(canvas) {
    return shown.find((each) => each.canvas === canvas);
  }

  /** Put the focus on the first row, or the last one. */
  function enter(last) {
    [...body.node.querySelectorAll("[data-row]")].at(last ? -1 : 0)?.focus();
  }

  return { node: body.node, show, at, enter, shown: () => shown };
}

/** One row: its label, what is painted, and what it stands at. */
export function lane(label, canvas, group = "") {
  return h("div", { class: `lane ${group}` }, h("div", { class: "label" }, label), canvas, h("div", { class: "value" }));
}

/** Rows in the order that they come in, those with an open episode first; those that `before` had keep their places. */
function arranged(rows, before) {
  const places = new Map(before.map((key, i) => [key, i]));
  const place = ({ key }) => places.get(key) ?? places.size;
  const open = ({ open: is }) => (is ? 0 : 1);
  return [...rows].sort((one, other) => (before.length ? place(one) - place(other) : 0) || open(one) - open(other));
}

function moveFocus(pressed) {
  const by = { ArrowUp: -1, ArrowDown: 1, Home: -Infinity, End: Infinity }[pressed.key];
  const buttons = [...pressed.currentTarget.querySelectorAll("[data-row]")];
  const at = buttons.indexOf(document.activeElement);
  if (by === undefined || at < 0) return;
  pressed.preventDefault();
  pressed.stopPropagation();
  buttons[Math.min(buttons.length - 1, Math.max(0, at + by))].focus();
}
