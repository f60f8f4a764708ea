// Recordings that are dropped on the page: sent, and judged as sessions of their own.

import { at } from "./address.js";
import { ask, items, Problem, send } from "./api.js";
import { h, Place } from "./dom.js";
import { dropped, packed } from "./pack.js";

const CHOSEN = "oracle-recording-spec"; // the spec that was chosen last in this tab
const PARTS = 1000;
const SHOWN = 5; // recordings that are over

/** Where recordings are chosen or dropped, and how far they are; `again` refreshes the page at once. */
export function dropView(again) {
  const drop = new Drop(again);
  return { node: drop.node, refresh: () => drop.refresh(), leave: () => drop.leave() };
}

class Drop {
  #again;
  #specs = new Place("select", { "aria-label": "spec that judges the recording" });
  #file = h("input", { type: "file", hidden: true, "aria-label": "recording", accept: ".bag,.db3,.mcap,.jsonl,.txt,.zstd,.tar", onchange: () => this.#take([...this.#file.files]) });
  #folder = h("input", { type: "file", hidden: true, webkitdirectory: true, "aria-label": "folder of a bag", onchange: () => this.#chosen() });
  #list = new Place("ul", { class: "recordings", "aria-label": "recordings" });
  #said = h("p", { "aria-live": "polite" });
  #sending = null; // aborts what is sent
  #bar = h("progress", { max: String(PARTS), value: "0", "aria-label": "sent so far" });
  #sent = h("p", { class: "sent", hidden: true });
  #mayNot = false;
  #depth = 0; // of the elements that a file is dragged over

  constructor(again) {
    this.#again = again;
    const choose = h("button", { type: "button", onclick: () => this.#file.click() }, "Choose a recording…");
    const folder = h("button", { type: "button", onclick: () => this.#folder.click() }, "… a folder");
    this.#sent.append("Sending… ", this.#bar, " ", h("button", { type: "button", onclick: () => this.#sending?.abort() }, "Cancel"));
    this.node = h("section", { class: "drop", "aria-label": "judge a recording", hidden: true },
      h("p", { class: "tools" }, h("label", {}, "Judge a recording by ", this.#specs.node),
        h("span", { class: "joint" }, choose, folder), this.#file, this.#folder,
        h("span", { class: "hint" }, "or drop it here: a bag, or its folder, MCAP, or JSON Lines")),
      this.#sent, this.#said, this.#list.node);
    this.#specs.node.addEventListener("change", () => sessionStorage.setItem(CHOSEN, this.#specs.node.value));
    for (const [name, listener] of Object.entries(this.#dragging)) addEventListener(name, listener);
  }

  async refresh() {
    if (this.#mayNot) return;
    let found, specs;
    try {
      [found, specs] = await Promise.all([items("recordings"), items("specs")]);
    } catch (problem) {
      if (!(problem instanceof Problem) || ![403, 404].includes(problem.status)) throw problem;
      this.#mayNot = true; // with this token
      return;
    }
    this.node.hidden = false;
    const sound = specs.filter((each) => each.properties.length).map((each) => each.id);
    if (this.#specs.show(sound, (ids) => ids.map((id) => h("option", { value: id }, id)))) {
      const chosen = sessionStorage.getItem(CHOSEN);
      if (sound.includes(chosen)) this.#specs.node.value = chosen;
    }
    const over = found.filter((each) => isOver(each)).slice(0, SHOWN);
    this.#list.show([...found.filter((each) => !isOver(each)), ...over], (shown) => shown.map((each) => this.#row(each)));
  }

  leave() {
    for (const [name, listener] of Object.entries(this.#dragging)) removeEventListener(name, listener);
  }

  #dragging = {
    dragenter: (drag) => this.#over(drag, 1),
    dragleave: (drag) => this.#over(drag, -1),
    dragover: (drag) => hasFiles(drag) && drag.preventDefault(),
    drop: (drag) => {
      if (!hasFiles(drag)) return;
      drag.preventDefault();
      this.#depth = 0;
      this.node.classList.remove("over");
      dropped(drag.dataTransfer).then(({ files, folder }) => this.#take(files, folder), () => this.#say("bad", "The folder can't be read."));
    },
  };

  #over(drag, step) {
    if (!hasFiles(drag)) return;
    this.#depth += step;
    this.node.classList.toggle("over", this.#depth > 0);
  }

  /** Send what lies in the folder that was chosen itself. */
  #chosen() {
    const found = [...this.#folder.files].filter(({ webkitRelativePath: path }) => path.split("/").length === 2);
    const name = this.#folder.files[0]?.webkitRelativePath.split("/")[0] ?? "folder";
    this.#take(found, name);
  }

  async #take(files, folder = null) {
    if (this.node.hidden || this.#sending) return;
    const file = packed(files, folder);
    if (!file) return this.#say("bad", "One recording at a time: drop a single file, the folder of a bag, or all files of one with its metadata.yaml.");
    if (!this.#specs.node.value) return this.#say("bad", "There is no spec to judge it by: write one, or start the server with --specs FOLDER.");
    this.#say("hint", "");
    this.#sending = new AbortController();
    this.#sent.hidden = false;
    const query = { spec: this.#specs.node.value, name: (folder ?? file.name).slice(0, 200) };
    try {
      const options = { signal: this.#sending.signal, progress: (part) => (this.#bar.value = part * PARTS) };
      await send("recordings", query, file, options);
    } catch (problem) {
      if (!(problem instanceof Problem)) throw problem;
      this.#say("bad", `${query.name}: ${problem.message}`);
    } finally {
      this.#sending = null;
      this.#sent.hidden = true;
      this.#bar.value = 0;
      this.#file.value = this.#folder.value = "";
    }
    this.#again();
  }

  #row(one) {
    const name = one.session ? h("a", { href: at(one.session) }, one.session) : null;
    const cancel = isOver(one) ? null : h("button", { type: "button", onclick: () => this.#cancel(one) }, "Cancel");
    const far = one.state === "judging" && one.total
      ? [h("progress", { max: String(one.total), value: String(one.read), "aria-label": `${one.name} judged so far` }), ` ${Math.floor((100 * one.read) / one.total)} %, `] : null;
    return h("li", {},
      h("strong", {}, one.name), ` by ${one.spec}: `, far, ...told(one), name && [" – ", name], " ", cancel,
      one.notes.map((note) => h("p", { class: "hint" }, note)));
  }

  async #cancel(one) {
    try {
      await ask("DELETE", `recordings/${encodeURIComponent(one.id)}`);
    } catch (problem) {
      if (!(problem instanceof Problem)) throw problem;
      this.#say("bad", problem.message);
    }
    this.#again();
  }

  #say(kind, text) {
    this.#said.className = kind;
    this.#said.textContent = text;
  }
}

function told({ state, events, error, exit, notes }) {
  const judged = `${events} event${events === 1 ? "" : "s"}`;
  if (state === "judged") {
    const none = notes.length ? h("span", { class: "waiting" }, "no violation, but see what is noted") : h("span", { class: "good" }, "no violation");
    const verdict = { 0: none, 1: h("span", { class: "bad" }, "violations") }[exit];
    return [`${judged}, `, verdict ?? h("span", { class: "waiting" }, "not all was judged")];
  }
  if (state === "failed" || state === "cancelled") return [h("span", { class: "bad" }, `incomplete, ${error}`)];
  return [state === "judging" ? judged : state];
}

function isOver({ state }) {
  return ["judged", "failed", "cancelled"].includes(state);
}

function hasFiles(drag) {
  return drag.dataTransfer?.types.includes("Files");
}
