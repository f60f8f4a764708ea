// A text field with numbered lines, and marks where something was found.

import { h } from "./dom.js";

/** A field; `changed` is called with the text as it is edited. */
export class Field {
  #area;
  #gutter = h("div", { class: "gutter", "aria-hidden": "true" });
  #marks = h("div", { class: "marks", "aria-hidden": "true" });
  #findings = [];
  #count = 0;

  constructor(name, changed) {
    this.#area = h("textarea", {
      "aria-label": name, spellcheck: "false", autocapitalize: "off", autocomplete: "off", wrap: "off", rows: "24",
      oninput: () => { this.#number(); changed(this.text); },
      onscroll: () => this.#follow(),
      onkeydown: (press) => this.#indent(press),
    });
    this.node = h("div", { class: "field" }, this.#gutter, h("div", { class: "written" }, this.#marks, this.#area));
    this.#number();
  }

  get text() {
    return this.#area.value;
  }

  set text(text) {
    this.#area.value = text;
    this.#number();
  }

  /** Say that findings are told in an element of some id. */
  describedBy(id) {
    this.#area.setAttribute("aria-describedby", id);
  }

  /** Mark findings, which have `line`, `column` and `severity`; their places are those of the text as it is now. */
  mark(findings) {
    this.#findings = findings;
    this.#area.setAttribute("aria-invalid", String(findings.some((each) => each.severity === "error")));
    const texts = this.text.split("\n");
    this.#marks.replaceChildren(...findings.map(({ line, column, severity }) => {
      const characters = [...(texts[line - 1] ?? "")];
      const [before, rest] = [characters.slice(0, column - 1).join(""), characters.slice(column - 1).join("")];
      const word = /^(\w+|\S)?/u.exec(rest)[0] || " ";
      const row = h("div", {}, before, h("mark", { class: severity }, word));
      row.style.top = `calc(${line - 1} * var(--row))`;
      return row;
    }));
    this.#number(true);
    this.#follow();
  }

  /** Put the cursor to a place, and show it. */
  goTo(line, column) {
    const texts = this.text.split("\n");
    const before = texts.slice(0, line - 1).reduce((sum, text) => sum + text.length + 1, 0);
    const at = Math.min(this.text.length, before + [...(texts[line - 1] ?? "")].slice(0, column - 1).join("").length);
    this.#area.focus();
    this.#area.setSelectionRange(at, at);
    const row = parseFloat(getComputedStyle(this.#area).lineHeight);
    this.#area.scrollTop = Math.max(0, (line - 1) * row - this.#area.clientHeight / 2);
  }

  focus() {
    this.#area.focus();
  }

  #number(anew = false) {
    const count = this.text.split("\n").length;
    if (count === this.#count && !anew) return;
    this.#count = count;
    const worst = new Map();
    for (const { line, severity } of this.#findings) if (worst.get(line) !== "error") worst.set(line, severity);
    this.#gutter.replaceChildren(h("div", {}, Array.from({ length: count }, (_, i) => h("span", { class: worst.get(i + 1) }, String(i + 1)))));
    this.#follow();
  }

  #follow() {
    const { scrollTop, scrollLeft } = this.#area;
    this.#marks.style.transform = `translate(${-scrollLeft}px, ${-scrollTop}px)`;
    if (this.#gutter.firstChild) this.#gutter.firstChild.style.transform = `translateY(${-scrollTop}px)`;
  }

  /** Begin a new line where the last one begins. */
  #indent(press) {
    if (press.key !== "Enter" || press.isComposing || press.ctrlKey || press.metaKey || press.altKey) return;
    const { selectionStart: at, value } = this.#area;
    const [indent] = /^ */.exec(value.slice(value.lastIndexOf("\n", at - 1) + 1, at));
    if (!indent) return;
    press.preventDefault();
    document.execCommand("insertText", false, `\n${indent}`); // which can be undone
  }
}
