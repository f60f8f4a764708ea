// Which sessions need somebody: what is wrong in each now, in which group it is, and which ones a search means.

import { now } from "./clock.js";
import { HOUR, time } from "./day.js";
import { byGravity as byOutcome } from "./words.js";

const FAILING = ["false", "currently_false"];
const GROUPS = ["Wrong now", "Not judged", "Degraded", "Wrong within the hour", "Fine", "Idle", "Recordings", "Closed"];

/** The kinds of sessions that can be asked for by themselves. */
export const KINDS = {
  All: () => true,
  ...Object.fromEntries(GROUPS.map((name) => [name, ({ group }) => group === name])),
};

/**
 * Sessions with their `group`, their `open` episodes, the gravest first, those of the last `day`, and the `latest` that was over
 * within the hour, in the order in which they need somebody. Those of the day are known from a time on (ms), which may lie
 * behind the day's begin (`cut: "day"`), or even the last hour's.
 */
export function grouped(sessions, episodes, day, from = 0) {
  const cut = from ? (from > now() - HOUR ? "hour" : "day") : null;
  const [open, of] = [episodes, day].map((all) => Map.groupBy(all, ({ session }) => session));
  const all = sessions.map((each) => {
    const found = each.status === "closed" ? [] : (open.get(each.id) ?? []).sort(byGravity);
    const own = each.clock === "wall" ? of.get(each.id) ?? [] : []; // simulated times are none of the day
    const [latest = null] = own.filter(({ until }) => until !== null && now() - time(until) < HOUR).sort((one, other) => time(other.until) - time(one.until));
    return { ...each, open: found, day: own, latest, cut, group: groupOf(each, found, latest) };
  });
  const rank = ({ group }) => GROUPS.indexOf(group);
  return all.sort((one, other) => rank(one) - rank(other) || byGravity(one.open[0], other.open[0])
    || time(other.latest?.until ?? 0) - time(one.latest?.until ?? 0)
    || byOutcome(one.outcome ?? "true", other.outcome ?? "true"));
}

/** Final episodes before others, then those that are open for longest. */
function byGravity(one, other) {
  if (!one || !other) return Number(!one) - Number(!other);
  const apart = BigInt(one.began) - BigInt(other.began);
  return Number(other.final) - Number(one.final) || (apart < 0n ? -1 : Number(apart > 0n));
}

function groupOf({ status, kind, live, idle, outcome, trouble, caveats, doubts }, open, latest) {
  if (status === "closed") return kind === "recording" ? "Recordings" : "Closed";
  if (open.length || FAILING.includes(outcome)) return "Wrong now";
  if (status === "unrestored" || trouble || (live && !["true", "currently_true"].includes(outcome))) return "Not judged";
  if (live && caveats.length) return "Degraded";
  if (latest) return "Wrong within the hour";
  if (live && doubts.length) return "Degraded";
  return idle || !live ? "Idle" : "Fine";
}

/**
 * Whether a search means a session: each of its words is in the session's name, its spec, the robot that it is forwarded from, or a
 * property that is violated, or was that day.
 */
export function matches({ id, spec, origin, open, day = [] }, search) {
  const names = [...new Set([...open, ...day].map(({ property }) => property))];
  const places = { "spec:": [spec], "property:": names, "session:": [id], "origin:": [origin ?? ""], "": [id, spec, ...names] };
  return search.toLowerCase().split(/\s+/).every((word) => {
    const kind = Object.keys(places).find((each) => word.startsWith(each));
    return places[kind].some((text) => text.toLowerCase().includes(word.slice(kind.length)));
  });
}
