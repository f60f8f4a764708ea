// The list of all specs, and the view of one.

import { get, items } from "./api.js";
import { h, Place, table } from "./dom.js";
import { stream } from "./words.js";

/** The list of specs. */
export function specsView() {
  const list = new Place("section");
  return {
    node: h("div", {}, h("h1", {}, "Specs"), list.node),
    refresh: async () => list.show(await items("specs"), listed),
  };
}

function listed(specs) {
  if (!specs.length) return h("p", { class: "hint" }, "None: start the server with --specs FOLDER.");
  return table("specs", ["spec", "description", "streams", "properties"], specs.map((each) => [
    h("a", { href: `#/specs/${encodeURIComponent(each.id)}` }, each.id),
    [each.description, each.problem ? h("p", { class: "complaint" }, each.problem) : null],
    String(each.streams.length),
    String(each.properties.length),
  ]));
}

/** One spec, with its text. */
export function specView(id) {
  const page = new Place("section");
  return {
    node: h("div", {}, h("h1", {}, id), page.node),
    refresh: async () => page.show(await get(`specs/${encodeURIComponent(id)}`), described),
  };
}

function described(spec) {
  return [
    h("p", {}, spec.description),
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
    h("pre", {}, spec.text),
    h("p", { class: "hint" }, `digest ${spec.digest}`),
  ];
}
