// The explanation of one verdict.

import { at } from "./address.js";
import { DelayedHistory, get, items, of, Problem } from "./api.js";
import { beforeView } from "./before.js";
import { diagramView } from "./diagram.js";
import { h, Place } from "./dom.js";
import { formulaView } from "./formula.js";
import { badge, causes, event, moment, place, span, waiting } from "./words.js";

const WITHIN = 600_000; // ms, as the command line waits: the session is judged again up to the verdict
const PROMPT = 300; // ms within which most explanations arrive, so that they are shown at once
const LATER = [404, 503]; // not in the history yet, or too many requests: tried again

/** A view of verdict `n`; `onShown` receives the steps that explain it, and its record, `again` is called when a slow answer arrives. */
export function verdictView(id, n, onShown, again) {
  const place = new Place("div", { "aria-live": "polite" });
  const around = [formulaView(id), diagramView(id), beforeView(id)];
  const outer = new Place("section", { class: "verdict" });
  const history = new DelayedHistory();
  let request = null;

  async function refresh({ clock, revising, spec }) {
    if (n && (!request || request.record?.early || await isRevised(revising?.passes))) await send();
    if (request?.problem) {
      const { problem } = request;
      request = null; // it is sent again at the next refresh
      throw problem;
    }
    const shown = n && (request?.record ?? { n, computing: true });
    onShown([...stepsOf(shown?.explanation?.reasons)], shown);
    place.show({ clock, shown }, () => (shown ? described(id, shown, clock) : []));
    outer.show(Boolean(n), (any) => (any ? [place.node, ...around.map((view) => view.node)] : []));
    const [formula, ...others] = around;
    const known = shown?.property ? shown : null;
    formula.show(known?.computing ? null : known, clock); // for which the session is judged again, too: one after the other
    for (const view of others) view.show(known, clock, spec);
  }

  /** Whether the verdict that is shown was revised since; looked up where the number of passes has changed. */
  async function isRevised(passes) {
    if (!request.record || request.record.computing || !history.isDue(passes)) return false;
    history.wasRead();
    return (await recordOf(id, n, "standing"))?.revised !== request.record.revised;
  }

  /** Request the explanation, and wait a moment for it; the last answer, or what is recorded, is shown until the next one arrives. */
  async function send() {
    const number = n;
    const mine = { leaving: new AbortController(), record: request?.record, problem: null };
    if (mine.record) mine.record.early = false;
    request = mine;
    let slow = false;
    const answered = explained(id, n, mine.leaving.signal).then(
      (record) => (mine.record = record),
      (problem) => (mine.problem = problem),
    ).then(() => slow && mine === request && again());
    await Promise.race([answered, new Promise((resolve) => setTimeout(resolve, PROMPT))]);
    slow = true;
    if (!mine.record && !mine.problem) showRecorded(mine, number);
  }

  /** Show what is recorded of a verdict until the answer to a request is there, which tells what is wrong. */
  async function showRecorded(mine, number) {
    const record = await recordOf(id, number, "standing").catch(() => undefined);
    if (!record || mine !== request || mine.record || mine.problem) return;
    mine.record = { ...record, computing: true };
    again();
  }

  /** Show another verdict, or none; an open request is aborted. */
  function goTo(other) {
    if (other === n) return;
    request?.leaving.abort();
    [request, n] = [null, other];
  }

  function leave() {
    goTo(null);
    for (const view of around) view.leave();
  }

  return { node: outer.node, refresh, goTo, leave };
}

/** The record with its explanation, or with the reason (`refusal`) why there is none, or none yet (`early`). */
async function explained(id, n, signal) {
  try {
    const record = await get(of(id, `verdicts/${n}/explanation`), {}, { within: WITHIN, signal });
    if (record.n === n) return { ...record, ...await revisionOf(id, record) };
    throw new TypeError(`no record ${n}`);
  } catch (problem) {
    if (!(problem instanceof Problem) || [0, 200, 401, 403].includes(problem.status)) throw problem;
    const record = await recordOf(id, n, "standing");
    const early = LATER.includes(problem.status);
    const last = problem.status === 404 && !record ? await lastOf(id) : null;
    return { ...record, ...await revisionOf(id, record), n, refusal: problem.message, early, last };
  }
}

/** The record of verdict `n` as it stands (`standing`), or was said at first (`first`); undefined where there is none. */
async function recordOf(id, n, as) {
  const [record] = await items(of(id, "verdicts"), { as, after: n - 1, limit: 1 });
  return record?.n === n ? record : undefined;
}

/** The number of a session's last verdict, 0 where there is none. */
async function lastOf(id) {
  const [record] = await items(of(id, "verdicts"), { order: "desc", limit: 1 });
  return record?.n ?? 0;
}

/** What was said at first of a record that was revised, and the revision; nothing of others. */
async function revisionOf(id, record) {
  if (!record?.revised) return {};
  const [said, revision] = await Promise.all([recordOf(id, record.n, "first"), recordOf(id, record.revised, "all")]);
  return { said, revision };
}

function* stepsOf(reasons) {
  for (const reason of reasons ?? []) {
    if (reason.event?.step) yield reason.event.step;
    yield* stepsOf(reason.reasons);
  }
}

function described(id, record, clock) {
  const { explanation } = record;
  return [
    h("h3", {}, record.property ? [`${record.property} `, badge(record.outcome), ` at ${place(record.step, record.stamp, clock)} `] : "Verdict ",
      h("span", { class: "hint" }, `#${record.n}`)),
    record.property ? facts(record, clock) : null,
    held(record, clock),
    record.revised ? revised(record) : null,
    record.computing ? h("p", { class: "hint" }, `${explanation ? "What else there is to it" : "The explanation"} is being computed: the session is judged again up to this verdict.`) : null,
    record.refusal ? h("p", { class: "complaint" }, record.refusal, beyond(id, record)) : null,
    explanation ? why(explanation) : null,
    record.about?.length ? unanswered(record, clock) : null,
  ];
}

/** Of a number behind the last one: which is the last. */
function beyond(id, { n, last }) {
  if (!last || n <= last) return null;
  return [". The last one is ", h("a", { href: at(id, last) }, `verdict ${last}`), "."];
}

/** The events that asked for what did not come. */
function unanswered({ about, about_count: count }, clock) {
  const rest = count > about.length ? ` (the first ${about.length})` : "";
  return [
    h("p", {}, `Not answered: ${count}${rest}`),
    h("ul", { class: "reasons" }, about.map((each) => h("li", { class: "fails" },
      `${event(each)} at ${place(each.step, each.stamp, clock)}`, signals("values", each.values)))),
  ];
}

function facts(record, clock) {
  const marks = ["late", "skewed", "degraded", "violation"].filter((each) => record[each]);
  const decided = record.decision && `decided: ${record.decision}${passed(record)}`;
  return h("p", {}, [
    event(record),
    `published ${moment(record.stamp, clock)}`,
    `arrived ${moment(record.arrived, clock)}`,
    // `judged` is in the server's time, `arrived` in the session's
    clock === "sim" ? `judged ${moment(record.judged)}` : `${record.decision ? "held" : "judged"} ${span(Number(record.judged) - Number(record.arrived))}${record.decision ? until(record) : " later"}`,
    decided,
    ...marks,
  ].filter(Boolean).join(" · "));
}

const UNTIL = {
  frontier: ", until every other stream was heard",
  clock: ", until the monitors had told how far the other streams are",
  max_delay: ", until `max_delay` was over: a stream was not heard",
  capacity: ", until there was no room to wait on",
};

/** Until what an event that was asked about was held; `held` says more where it is known what it waited for. */
function until({ released, waited }) {
  return waited ? "" : UNTIL[released] ?? "";
}

/** Who held an event up, and for how long; nothing of one that did not wait. */
function held(record, clock) {
  const why = waiting(record);
  if (!why) return null;
  const long = clock === "sim" ? "" : ` ${span(Number(record.judged) - Number(record.arrived))}`;
  return h("p", { class: "held" }, h("strong", {}, `Held up${long}`), `: it ${why}.`);
}

function revised({ revised: number, said, revision }) {
  return h("p", { class: "waiting" }, "Said at first: ", said ? badge(said.outcome) : "something else", ", and revised",
    revision ? ` since ${causes(revision)}` : "", h("span", { class: "hint" }, ` #${number}`));
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
    signals("signals of the event", explanation.event?.signals),
  ];
}

function reasons(all) {
  if (!all?.length) return null;
  return h("ul", { class: "reasons" }, all.map((reason) => h("li", { class: reason.holds ? "holds" : "fails" },
    h("code", {}, reason.formula), ` ${reason.text}`, failing(reason.failing),
    reason.event ? signals(`step ${reason.event.step ?? "–"}, ${event(reason.event)}`, reason.event.signals) : null,
    reasons(reason.reasons))));
}

/** The constraints of an atom that were not met: what was there, and what was wanted. */
function failing(all) {
  if (!all?.length) return null;
  const missing = { absent: "absent", failed: "not computed" };
  return h("dl", { class: "failing" }, all.map(({ signal, op, wanted, value, missing: why }) => [
    h("dt", {}, signal),
    h("dd", {}, `${why ? missing[why] : shown(value)}, wanted ${op === "==" ? "" : `${op} `}${shown(wanted)}`),
  ]));
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
