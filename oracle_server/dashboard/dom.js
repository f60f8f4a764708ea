// Elements from values. What a robot says only ever becomes text: nothing here reads HTML.

/** A new element; `on…` attributes are listeners, null and false ones are left out, as null children are. */
export function h(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value !== null && value !== undefined && value !== false) node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children.flat(Infinity).filter((child) => child !== null && child !== undefined));
  return node;
}

/** A table with a head; each row is a list of cells, or a row made already. */
export function table(name, head, rows) {
  const cells = (row) => h("tr", {}, row.map((cell) => h("td", {}, cell)));
  return h("table", { class: name },
    h("thead", {}, h("tr", {}, head.map((title) => h("th", { scope: "col" }, title)))),
    h("tbody", {}, rows.map((row) => (row instanceof Node ? row : cells(row)))));
}

/** A place that is built anew only when what it shows has changed, so that focus and selection stay. */
export class Place {
  #shown;

  constructor(name, attributes = {}) {
    this.node = h(name, attributes);
  }

  /** Show what `build` makes of `value`; whether that was another value than before. */
  show(value, build) {
    const key = JSON.stringify(value, (_, each) => (typeof each === "bigint" ? `${each}n` : each));
    if (key === this.#shown) return false;
    this.node.replaceChildren(...[build(value)].flat(Infinity).filter((child) => child !== null));
    this.#shown = key; // not before: what could not be built is not shown
    return true;
  }
}
