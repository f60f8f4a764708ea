// Builds elements from values. Data from robots only ever becomes text: nothing here parses HTML.

/** A new element; `on…` attributes are listeners; attributes that are null or false, and null children, are left out. */
export function h(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(key, value === true ? "" : key === "title" ? seen(value) : value);
  }
  node.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined).map(seen));
  return node;
}

const UNSEEN = /[\u0000-\u0008\u000b\u000c\u000e-\u001f\u007f-\u009f\u00ad\u200b\u2028-\u202e\u2060\u2066-\u2069\ufeff]/g;

/** A text with an escape, as `\u202e`, for each character that is not seen, by which what is beside it may be told in another order, or two texts look alike. */
function seen(child) {
  return typeof child === "string" ? child.replace(UNSEEN, (each) => `\\u${each.charCodeAt(0).toString(16).padStart(4, "0")}`) : child;
}

const [LONG, TAIL] = [20, 10]; // characters of a name: of a longer one its end is always seen

/** A name that is cut in its middle where there is too little room, since long names often differ at their ends. */
export function named(text) {
  if (text.length <= LONG) return text;
  return h("span", { class: "named" }, h("span", {}, text.slice(0, -TAIL)), h("span", {}, text.slice(-TAIL)));
}

/** The attributes of an element that scrolls sideways where its table is too wide, by keys too. */
export function wide(name) {
  return { class: "wide", tabindex: 0, role: "region", "aria-label": name };
}

/** A table with a head; each row is a list of cells, or a row element. */
export function table(name, head, rows) {
  const cells = (row) => h("tr", {}, row.map((cell) => h("td", {}, cell)));
  return h("table", { class: name, "aria-label": name },
    h("thead", {}, h("tr", {}, head.map((title) => h("th", { scope: "col" }, title)))),
    h("tbody", {}, rows.map((row) => (row instanceof Node ? row : cells(row)))));
}

/**
 * Make one stop of the Tab key of what `selector` finds in an element; `keys` go on from there by so many. The function
 * that is returned is to be called where what it finds has changed.
 */
export function rove(node, selector, keys) {
  const found = () => [...node.querySelectorAll(selector)];
  const settle = (stop) => {
    const all = found();
    const one = stop ?? all.find((each) => each.tabIndex === 0) ?? all[0];
    for (const each of all) each.tabIndex = each === one ? 0 : -1;
  };
  node.addEventListener("focusin", ({ target }) => target.matches(selector) && settle(target));
  node.addEventListener("keydown", (pressed) => {
    const all = found();
    const at = all.indexOf(document.activeElement);
    const to = all[at + keys[pressed.key]];
    if (at < 0 || !to) return;
    pressed.preventDefault();
    to.focus();
  });
  return () => settle();
}

export const UP_AND_DOWN = { ArrowUp: -1, ArrowDown: 1 };
export const TO_AND_FRO = { ArrowLeft: -1, ArrowRight: 1 };

/** An element that is rebuilt only when the value that it shows has changed, so that selection is kept; the focus is, too, where it is rebuilt. */
export class Place {
  #shown;

  constructor(name, attributes = {}) {
    this.node = h(name, attributes);
  }

  /** Show the elements that `build` makes of `value`, if it has changed; returns whether it has. */
  show(value, build) {
    const key = JSON.stringify(value, (_, each) => (typeof each === "bigint" ? `${each}n` : each));
    if (key === this.#shown) return false;
    const made = [build(value)].flat(Infinity).filter((child) => child !== null);
    const focused = this.node.contains(document.activeElement) ? document.activeElement : null;
    const place = alike(this.node, focused).indexOf(focused);
    this.node.replaceChildren(...made);
    alike(this.node, focused)[place]?.focus({ preventScroll: true });
    this.#shown = key; // only now, since building may fail
    return true;
  }
}

/** The elements within a node that are to a reader what another one is: links to the same place, or of the same name and text. */
function alike(node, other) {
  if (!other) return [];
  const what = (each) => each.getAttribute("href") ?? each.textContent;
  return [...node.querySelectorAll(other.localName)].filter((each) => what(each) === what(other));
}

/** A new element of a drawing. */
export function svg(name, attributes = {}, ...children) {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) if (value !== null && value !== undefined) node.setAttribute(key, String(value));
  node.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined).map(seen));
  return node;
}
