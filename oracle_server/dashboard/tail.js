// Answers by time that are brought up to date by what came since: buckets lie on a grid that does not depend on who asks.

const LEAST = 4; // buckets that are asked for again, so that no narrower ones cover their time
const NULLS = ["min", "max", "mean", "text"]; // columns in which nothing is null; in others it is 0
const COLUMNS = ["lanes", "degraded", "violations", "steps", "late", "streams", "asked", "denied", "hold", "signals"];

/** What to ask for, to bring an answer up to date until a time (ns): its `since`, and how many `buckets`. */
export function sinceThen(answer, until) {
  const [begin, width, last] = [answer.since, answer.width, answer.last].map(BigInt);
  const end = until / width;
  const from = [last / width - 1n, end - BigInt(LEAST) + 1n].reduce((one, other) => (other < one ? other : one));
  return { since: from < begin / width ? begin : from * width, buckets: Number(end - from) + 1 };
}

/** An answer with the buckets of a later one in their places, from `since` (ns) on; null where their widths differ. */
export function joined(answer, later, since) {
  if (BigInt(answer.width) !== BigInt(later.width)) return null;
  const bucket = (time) => Number((BigInt(time) - BigInt(answer.since)) / BigInt(answer.width));
  const [cut, at] = [Math.max(0, bucket(since)), bucket(later.since)];
  if (at < 0 || at > answer.buckets + later.buckets) return null;
  const columns = COLUMNS.map((name) => [name, column(name, answer[name], later[name], cut, at, later.buckets)]);
  const begin = BigInt(answer.since) + BigInt(cut) * BigInt(answer.width);
  return { ...later, ...Object.fromEntries(columns), since: begin, buckets: at + later.buckets - cut };
}

/** A column from `cut` to `at`, and the later one behind it, which has so many buckets; or an object of columns. */
function column(name, old, fresh, cut, at, buckets) {
  const any = fresh ?? old;
  if (typeof any === "string") {
    const blank = name === "degraded" ? "0" : " ";
    return `${(old ?? "").padEnd(at, blank).slice(cut, at)}${fresh ?? blank.repeat(buckets)}`;
  }
  if (Array.isArray(any)) {
    const blank = NULLS.includes(name) ? null : 0;
    const before = Array.from({ length: Math.max(0, at - cut) }, (_, i) => old?.[cut + i] ?? blank);
    return [...before, ...(fresh ?? Array(buckets).fill(blank))];
  }
  if (!(any instanceof Object)) return any;
  const inner = ["lanes", "degraded", "violations"].includes(name) ? () => name : (key) => key;
  const keys = new Set([...Object.keys(old ?? {}), ...Object.keys(fresh ?? {})]);
  return Object.fromEntries([...keys].map((key) => [key, column(inner(key), old?.[key], fresh?.[key], cut, at, buckets)]));
}
