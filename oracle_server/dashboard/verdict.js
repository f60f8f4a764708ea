// One verdict, and why it is as it is.

import { get, of, Problem } from "./api.js";
import { h, Place } from "./dom.js";
import { badge, event, moment, span } from "./words.js";

/** Verdict `n` of a session; `onWitnesses` gets the steps that explain it. */
export function verdictView(id, n, onWitnesses) {
  const place = new Place("section", { class: "verdict", "aria-live": "polite" });
  let told = null;

  async function refresh({ clock }) {
    if (n && (told?.n !== n || told.early)) {
      const asked = n;
      const found = await explained(id, asked);
      if (asked === n) told = found;
    }
    const shown = told?.n === n ? told : null;
    onWitnesses(shown ? [...stepsOf(shown.explanation?.reasons)] : []);
    place.show({ clock, shown }, () => (shown ? described(shown, clock) : []));
  }

  return { node: place.node, refresh, goTo: (other) => (n = other) };
}

/** The record with its explanation; without one, and with the reason, where it can't be had, or not yet. */
async function explained(id, n) {
  try {
    return await get(of(id, `verdicts/${n}/explanation`));
  } catch (problem) {
    if (!(problem instanceof Problem) || ![404, 409].includes(problem.status)) throw problem;
    const { items } = await get(of(id, "verdicts"), { after: n - 1, limit: 1 });
    return { ...(items[0]?.n === n ? items[0] : {}), n, refusal: problem.message, early: problem.status === 404 };
  }
}

function* stepsOf(reasons) {
  for (const reason of reasons ?? []) {
    if (reason.event?.step) yield reason.event.step;
    yield* stepsOf(reason.reasons);
  }
}

function described(record, clock) {
  const { explanation } = record;
  return [
    h("h3", {}, `Verdict ${record.n}`, record.property ? [`: ${record.property} `, badge(record.outcome)] : null),
    record.property ? facts(record, clock) : null,
    record.refusal ? h("p", { class: "complaint" }, record.refusal) : null,
    explanation ? why(explanation) : null,
  ];
}

function facts(record, clock) {
  const marks = ["late", "skewed", "degraded", "violation"].filter((each) => record[each]);
  const decided = record.decision && `decided: ${record.decision}${passed(record)}`;
  return h("p", {}, [
    `step ${record.step ?? "–"}: ${event(record)}`,
    `published ${moment(record.stamp, clock)}`,
    `arrived ${moment(record.arrived, clock)}`,
    // what is judged is told in the server's time, which a simulation's is not
    clock === "sim" ? `judged ${moment(record.judged)}` : `judged ${span(Number(record.judged) - Number(record.arrived))} later`,
    decided,
    ...marks,
  ].filter(Boolean).join(" · "));
}

function passed({ passed: went }) {
  return went === null ? "" : went ? ", passed on" : ", withheld";
}

function why(explanation) {
  const values = Object.entries(explanation.values ?? {}).map(([name, value]) => `${name} = ${shown(value)}`);
  const more = explanation.other_values ? ` (and ${explanation.other_values} other values)` : "";
  return [
    h("p", {}, h("code", {}, explanation.formula)),
    values.length ? h("p", {}, `for ${values.join(", ")}${more}`) : null,
    reasons(explanation.reasons),
    signals("what formulas saw of the event", explanation.event?.signals),
  ];
}

function reasons(all) {
  if (!all?.length) return null;
  return h("ul", { class: "reasons" }, all.map((reason) => h("li", { class: reason.holds ? "holds" : "fails" },
    h("code", {}, reason.formula), ` ${reason.text}`,
    reason.event ? signals(`step ${reason.event.step ?? "–"}, ${event(reason.event)}`, reason.event.signals) : null,
    reasons(reason.reasons))));
}

function signals(title, values) {
  const entries = Object.entries(values ?? {});
  if (!entries.length) return null;
  return h("details", {}, h("summary", {}, title),
    h("dl", {}, entries.map(([name, value]) => [h("dt", {}, name), h("dd", {}, shown(value))])));
}

function shown(value) {
  if (value === null) return "any other value";
  return typeof value === "string" ? JSON.stringify(value) : String(value);
}
