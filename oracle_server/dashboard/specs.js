// The list of all specs, and the view of one.

import { get, items } from "./api.js";
import { h, Place, table, wide } from "./dom.js";
import { stream } from "./words.js";

/** The list of specs. */
export function specsView() {
  const list = new Place("section", wide("specs"));
  return {
    node: h("div", {}, h("h1", {}, "Specs"), list.node, newSpec()),
    refresh: async () => list.show(await items("specs"), listed),
  };
}

function newSpec() {
  const field = h("input", { name: "id", required: true, pattern: "[A-Za-z0-9_.\\-]{1,64}", title: "1 to 64 letters, digits, and any of . _ -", "aria-label": "id of a new spec", placeholder: "id", autocomplete: "off" });
  const entered = (submitted) => {
    submitted.preventDefault();
    location.hash = `#/edit/${encodeURIComponent(field.value)}`;
  };
  return h("form", { class: "tools new", onsubmit: entered }, h("span", { class: "hint" }, "A new spec:"), field, h("button", {}, "Write"));
}

function listed(specs) {
  if (!specs.length) return h("p", { class: "hint" }, "None: start the server with --specs FOLDER.");
  return table("specs", ["spec", "description", "streams", "properties"], specs.map((each) => [
    h("a", { href: each.problem ? editing(each.id) : `#/specs/${encodeURIComponent(each.id)}` }, each.id),
    [each.description, each.problem ? h("p", { class: "complaint" }, each.problem) : null],
    String(each.streams.length),
    String(each.properties.length),
  ]));
}

/** One spec, with its text. */
export function specView(id) {
  const page = new Place("section", wide("spec"));
  return {
    node: h("div", {}, h("h1", {}, id), page.node),
    refresh: async () => page.show(await get(`specs/${encodeURIComponent(id)}`), described),
  };
}

function editing(id) {
  return `#/edit/${encodeURIComponent(id)}`;
}

function described(spec) {
  return [
    h("p", {}, spec.description),
    h("p", {}, h("a", { href: editing(spec.id) }, "Edit")),
    h("h2", {}, "Properties"),
    table("properties", ["property", "formula"], spec.properties.map((each) => [
      each.id,
      [h("code", {}, each.formula), h("p", { class: "hint" }, each.description)],
    ])),
    ...(spec.derive ? [
      h("h2", {}, "Derived signals"),
      table("derived signals", ["signal", "what it is"], spec.derive.map((each) => [each.name, h("code", {}, each.signal)])),
    ] : []),
    h("h2", {}, "Streams"),
    table("streams", ["stream", "type", "action"], spec.streams.map((each) => [
      stream(each.name, each.kind), each.type ?? "any", each.action,
    ])),
    h("h2", {}, "Text"),
    h("pre", { tabindex: 0 }, spec.text),
    h("p", { class: "hint" }, `digest ${spec.digest}`),
  ];
}
