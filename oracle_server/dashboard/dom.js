// Builds elements from values. Data from robots only ever becomes text: nothing here parses HTML.

/** A new element; `on…` attributes are listeners; attributes that are null or false, and null children, are left out. */
export function h(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return node;
}

/** A table with a head; each row is a list of cells, or a row element. */
export function table(name, head, rows) {
  const cells = (row) => h("tr", {}, row.map((cell) => h("td", {}, cell)));
  return h("table", { class: name, "aria-label": name },
    h("thead", {}, h("tr", {}, head.map((title) => h("th", { scope: "col" }, title)))),
    h("tbody", {}, rows.map((row) => (row instanceof Node ? row : cells(row)))));
}

/** An element that is rebuilt only when the value that it shows has changed, so that focus and selection are kept. */
export class Place {
  #shown;

  constructor(name, attributes = {}) {
    this.node = h(name, attributes);
  }

  /** Show the elements that `build` makes of `value`, if it has changed; returns whether it has. */
  show(value, build) {
    const key = JSON.stringify(value, (_, each) => (typeof each === "bigint" ? `${each}n` : each));
    if (key === this.#shown) return false;
    this.node.replaceChildren(...[build(value)].flat(Infinity).filter((child) => child !== null));
    this.#shown = key; // only now, since building may fail
    return true;
  }
}
