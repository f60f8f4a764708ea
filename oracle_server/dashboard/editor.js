// A spec as it is written: checked as one types, compared with what is there, and stored.

import { ask, items, Problem } from "./api.js";
import { differing, shortened } from "./diff.js";
import { h } from "./dom.js";
import { Field } from "./field.js";

const AFTER = 300; // ms without a key before the text is checked
const PATIENCE = 30_000; // ms for a check, and for the storing
const AGAIN = 3_000; // ms after which a check that failed is tried again
const LISTED = 20; // sessions that are named

/** The editor of a spec, which there may not be yet. */
export function editorView(id) {
  const editor = new Editor(id);
  return { key: `edit ${id}`, node: editor.node, refresh: () => editor.refresh(), leave: () => editor.leave(), goTo() {} };
}

class Editor {
  #id;
  #base = null; // what the server has: its text, its tag, and where from; null before it was asked
  #field;
  #told = h("p", { id: "told", role: "status" });
  #findings = h("ul", { class: "findings", "aria-label": "findings" });
  #formulas = h("div", {});
  #review = h("section", { class: "review", "aria-label": "changes" });
  #said = h("p", { role: "status" });
  #source = h("p", { class: "hint" });
  #store;
  #timer;
  #checking; // aborts the check that goes on
  #sound = false;

  constructor(id) {
    this.#id = id;
    this.#field = new Field(`text of ${id}`, () => this.#edited());
    this.#field.describedBy("told");
    this.#store = h("button", { type: "button", disabled: true, onclick: () => this.#compare() }, "Review and store…");
    const discard = h("button", { type: "button", onclick: () => this.#discard() }, "Discard changes");
    this.node = h("div", { class: "editor" },
      h("h1", {}, `Edit ${id}`), this.#source, this.#field.node,
      h("div", { class: "tools" }, this.#store, discard, h("span", { class: "hint" }, "Ctrl+S reviews")),
      this.#told, this.#findings, this.#said, this.#review, this.#formulas);
    this.node.addEventListener("keydown", (press) => this.#shortcut(press));
    addEventListener("beforeunload", this.#warn);
  }

  async refresh() {
    if (this.#base !== null) return;
    this.#base = await present(this.#id);
    const draft = kept(this.#id);
    this.#field.text = draft?.text ?? (this.#base.tag === null ? template(this.#id) : this.#base.text);
    if (draft?.tag !== undefined && draft.tag !== this.#base.tag) this.#say("bad", "This draft was begun with another text than the one that is there now.");
    else if (draft) this.#say("hint", "Your draft, which is not stored.");
    this.#source.textContent = origin(this.#base);
    this.#check();
  }

  leave() {
    clearTimeout(this.#timer);
    this.#checking?.abort();
    removeEventListener("beforeunload", this.#warn);
  }

  get #dirty() {
    return this.#base !== null && this.#field.text !== this.#base.text;
  }

  #warn = (leaving) => {
    if (this.#dirty) leaving.preventDefault();
  };

  #edited() {
    if (this.#base === null) return;
    keep(this.#id, this.#dirty ? { text: this.#field.text, tag: this.#base.tag } : null);
    this.#review.replaceChildren();
    this.#say("hint", "");
    this.#tell("hint", "Checking…"); // what was found is of another text
    this.#await(AFTER);
  }

  #await(time) {
    this.#sound = false;
    this.#store.disabled = true;
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => this.#check(), time);
  }

  /** Check the text as it is now; an earlier check has no effect any more. */
  async #check() {
    clearTimeout(this.#timer);
    this.#checking?.abort();
    const mine = (this.#checking = new AbortController());
    try {
      const path = `specs/${encodeURIComponent(this.#id)}/check`;
      const { document: found } = await ask("POST", path, {}, { body: this.#field.text, signal: mine.signal, within: PATIENCE });
      if (!mine.signal.aborted) this.#show(found);
    } catch (problem) {
      if (mine.signal.aborted) return;
      if (!(problem instanceof Problem)) throw problem;
      this.#tell("bad", `Not checked: ${problem.message}`);
      if (problem.status === 0 || problem.status >= 429) this.#await(AGAIN);
    }
  }

  #show({ sound, findings, formulas }) {
    this.#sound = sound;
    this.#store.disabled = !sound || !this.#dirty;
    const count = (severity) => findings.filter((each) => each.severity === severity).length;
    this.#tell(sound ? "good" : "bad", [
      sound ? "sound" : "not sound", ...["error", "warning"].map((each) => counted(count(each), each)).filter(Boolean),
    ].join(", "));
    this.#field.mark(findings);
    this.#findings.replaceChildren(...findings.map((each) => h("li", { class: each.severity },
      h("button", { type: "button", onclick: () => this.#field.goTo(each.line, each.column) },
        h("code", {}, `${each.line}:${each.column}`), ` ${each.severity}: ${each.message}`))));
    this.#formulas.replaceChildren(...(formulas.length ? [
      h("h2", {}, "Formulas as they are judged"),
      h("dl", { class: "formulas" }, formulas.map((each) => [
        h("dt", {}, each.property), h("dd", {}, each.formula, each.time === "seconds" ? " (in seconds)" : ""),
      ])),
    ] : []));
  }

  /** Show what would change, and for whom not. */
  async #compare() {
    if (!this.#sound || !this.#dirty) return;
    const text = this.#field.text;
    let using;
    try {
      const open = await items("sessions", { brief: true });
      using = open.filter((each) => each.spec === this.#id && each.status === "open").map((each) => each.id);
    } catch (problem) {
      if (!(problem instanceof Problem)) throw problem;
      using = problem.message;
    }
    if (text !== this.#field.text) return;
    const confirm = h("button", { type: "button", class: "primary", onclick: () => this.#put(text) }, this.#base.tag === null ? "Store as a new spec" : "Store in place of what is there");
    this.#review.replaceChildren(
      h("h2", {}, "What changes"), changes(this.#base.text, text), ...keeping(using),
      h("div", { class: "tools" }, confirm, h("button", { type: "button", onclick: () => this.#back() }, "Go on editing")));
    confirm.focus();
  }

  #back() {
    this.#review.replaceChildren();
    this.#field.focus();
  }

  async #put(text) {
    this.#say("hint", "Storing…");
    this.#review.querySelectorAll("button").forEach((button) => (button.disabled = true));
    const condition = this.#base.tag === null ? { "If-None-Match": "*" } : { "If-Match": this.#base.tag };
    try {
      const path = `specs/${encodeURIComponent(this.#id)}`;
      const { tag } = await ask("PUT", path, {}, { body: text, headers: condition, within: PATIENCE });
      this.#base = { text, tag, source: "put" };
      keep(this.#id, this.#dirty ? { text: this.#field.text, tag } : null);
      this.#source.textContent = origin(this.#base);
      this.#store.disabled = true;
      this.#say("good", "Stored. Sessions that are opened from now on are judged by it.");
    } catch (problem) {
      if (!(problem instanceof Problem)) throw problem;
      if (problem.status === 412) return this.#conflict();
      this.#say("bad", `Not stored: ${problem.message}`);
    }
    this.#back();
  }

  /** Somebody else has stored another text: show what storing this one would change of theirs. */
  async #conflict() {
    this.#say("bad", "Not stored: the spec was changed meanwhile. This is what yours would change of what is there now.");
    this.#base = await present(this.#id);
    this.#source.textContent = origin(this.#base);
    keep(this.#id, { text: this.#field.text, tag: this.#base.tag });
    await this.#compare();
  }

  #discard() {
    if (!this.#dirty || !confirm("Discard what is not stored?")) return;
    this.#field.text = this.#base.text;
    this.#edited();
    this.#field.focus();
  }

  #shortcut(press) {
    if (press.key !== "s" || !(press.ctrlKey || press.metaKey)) return;
    press.preventDefault();
    this.#compare();
  }

  #tell(kind, text) {
    this.#told.className = kind;
    this.#told.textContent = text;
  }

  #say(kind, text) {
    this.#said.className = kind;
    this.#said.textContent = text;
  }
}

/** What the server has of a spec. */
async function present(id) {
  try {
    const { document: spec, tag } = await ask("GET", `specs/${encodeURIComponent(id)}`);
    return { text: spec.text, tag, source: spec.source };
  } catch (problem) {
    if (problem instanceof Problem && problem.status === 404) return { text: "", tag: null, source: "new" };
    if (problem instanceof Problem && problem.status === 422) {
      const { text } = problem.document ?? {};
      return { text: text ?? "", tag: "*", source: text === undefined ? "hidden" : "unsound", problem: problem.message };
    }
    throw problem;
  }
}

function origin({ source, problem }) {
  if (source === "new") return "There is no such spec yet.";
  if (source === "unsound") return "Its file is unsound, so that nothing is judged by it. The file stays as it is: what is stored goes before it.";
  if (source === "hidden") return `Its file is unsound, and can't be shown here. What is stored goes before it. ${problem}`;
  if (source === "file") return "From the specs folder, whose file stays as it is: what is stored goes before it.";
  return "Stored over HTTP.";
}

function template(id) {
  return `id: ${id}\nstreams:\n  - topic: /scan\n    signals: {nearest: min(msg.ranges)}\nproperties:\n  - id: keeps_clear\n    formula: "{nearest >= 0.3}"\n`;
}

function changes(old, now) {
  const rows = shortened(differing(old, now));
  if (rows.every((row) => row === null)) return h("p", { class: "hint" }, "Only whether the last line has an end.");
  return h("pre", { class: "diff", tabindex: "0", role: "group", "aria-label": "lines that change" }, rows.map((row) => {
    if (row === null) return h("span", { class: "hint" }, "  …");
    return h({ "+": "ins", "-": "del", " ": "span" }[row.sign], {}, `${row.sign} ${row.text}`);
  }));
}

/** Open sessions go on by what they were opened with; `using` are their names, or why these are not known. */
function keeping(using) {
  if (typeof using === "string") return [h("p", { class: "bad" }, `Which sessions keep what they were opened with is not known: ${using}`)];
  if (!using.length) return [h("p", { class: "hint" }, "No open session is judged by it.")];
  const named = using.slice(0, LISTED).flatMap((name, i) => [i ? ", " : "", h("a", { href: `#/sessions/${encodeURIComponent(name)}` }, name)]);
  const more = using.length > LISTED ? ` and ${using.length - LISTED} more` : "";
  return [h("p", {}, `${counted(using.length, "open session")} ${using.length === 1 ? "keeps" : "keep"} the text that it was opened with: `, named, more)];
}

function counted(number, noun) {
  return number ? `${number} ${noun}${number === 1 ? "" : "s"}` : "";
}

function kept(id) {
  try {
    return JSON.parse(sessionStorage.getItem(`oracle-draft ${id}`));
  } catch {
    return null;
  }
}

/** Keep a draft for this tab, until it is closed; none where there is no room for it. */
function keep(id, draft) {
  try {
    if (draft === null) sessionStorage.removeItem(`oracle-draft ${id}`);
    else sessionStorage.setItem(`oracle-draft ${id}`, JSON.stringify(draft));
  } catch {
    sessionStorage.removeItem(`oracle-draft ${id}`);
  }
}
