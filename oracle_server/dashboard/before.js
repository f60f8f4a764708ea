// Whether a property failed before a verdict: the episodes before it, in this session and in others that are judged by its spec.

import { at } from "./address.js";
import { get, of } from "./api.js";
import { h, Place, rove, UP_AND_DOWN } from "./dom.js";
import { lasted, worstOf } from "./episodes.js";
import { moment, ordered, span } from "./words.js";

const LIMIT = 100; // episodes that are looked at
const SHOWN = 5;

/** The episodes before the verdict that is shown. */
export function beforeView(id) {
  const list = new Place("section", { class: "before", "aria-label": "Before" });
  const settle = rove(list.node, "a", UP_AND_DOWN);
  let [shown, mine] = [null, 0];

  /** Show those before a record's verdict, by the session's `spec`; nothing without a record. */
  function show(record, clock, spec) {
    if ((record?.n ?? null) === shown) return;
    shown = record?.n ?? null;
    const number = ++mine;
    if (!shown) return list.show(null, () => []);
    before(id, record, clock, spec).then(
      (found) => number === mine && (list.show(found, () => listed(id, record, clock, found)), settle()),
      () => number === mine && (shown = null), // asked again with the next refresh
    );
  }

  return { node: list.node, show, leave: () => mine++ };
}

/** The episodes of a property that began before a verdict, but for the one that it is in: `here`, and in `others`. */
async function before(id, record, clock, spec) {
  const [{ n, property }, stamp] = [record, ordered(record)];
  const query = { property, until: stamp, order: "desc", limit: LIMIT };
  const none = { items: [], next: null };
  const [own, all] = await Promise.all([get(of(id, "episodes"), query), clock === "sim" ? none : get("episodes", query)]); // simulated times are others
  const ends = ({ until }) => until === null || BigInt(until) >= BigInt(stamp);
  return {
    here: { found: own.items.filter((each) => each.first < n && !ends(each)), more: own.next !== null },
    others: { found: all.items.filter((each) => each.spec === spec && each.session !== id), more: all.next !== null },
  };
}

function number({ found, more }) {
  return more ? (found.length ? `${found.length} or more` : "it is not known how many") : found.length || "none";
}

function listed(id, record, clock, { here, others }) {
  const [{ property }, stamp] = [record, ordered(record)];
  const found = [...here.found, ...others.found].sort((one, other) => (BigInt(one.began) < BigInt(other.began) ? 1 : -1));
  const known = found.length || here.more || others.more;
  const ago = (time) => `${span(BigInt(stamp) - BigInt(time))} before`;
  return [
    h("p", { class: "caption tools" }, h("strong", {}, `Has ${property} failed before?`),
      h("span", { class: "hint" }, known ? `${number(here)} in this session, ${number(others)} in others` : "Not that is known.")),
    found.length ? h("ul", {}, found.slice(0, SHOWN).map((each) => h("li", {},
      h("a", { href: at(each.session, each.first) }, moment(each.began, clock)), ` ${ago(each.began)}, `,
      each.session === id ? "here" : h("strong", {}, each.session), each.open ? ", still open" : ` for ${span(lasted(each, null))}`,
      h("span", { class: "hint" }, ` ${worstOf(each)}`)))) : null,
  ];
}
