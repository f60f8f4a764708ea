// The numbers that formulas compare a signal with, as lines beside its values: which are drawn, and what they are called.

const NEAR = 0.5; // of the height that values and the nearest bounds take: what is further away is only counted

/**
 * What a plot reaches from and to, the lines in it, those that matter most first, and how many bounds lie above and below it.
 * `values` are the signal's, `failing` the properties that fail in view.
 */
export function linesOf(bounds, values, failing) {
  const all = merged(bounds, failing);
  const numbers = all.map(({ value }) => value);
  const [low, high] = values.length ? [Math.min(...values), Math.max(...values)] : [Math.min(...numbers), Math.max(...numbers)];
  const least = Math.max(...numbers.filter((each) => each <= low), -Infinity);
  const most = Math.min(...numbers.filter((each) => each >= high), Infinity);
  let [from, to] = [Number.isFinite(least) ? least : low, Number.isFinite(most) ? most : high];
  const room = NEAR * (to - from);
  const shown = all.filter(({ value }) => value >= from - room && value <= to + room);
  [from, to] = [Math.min(from, ...shown.map(({ value }) => value)), Math.max(to, ...shown.map(({ value }) => value))];
  const away = ({ value }) => Math.min(Math.abs(value - low), Math.abs(value - high)); // from where the values turn
  shown.sort((one, other) => other.fails - one.fails || away(one) - away(other));
  const count = (test) => all.filter(test).reduce((sum, { names }) => sum + names.length, 0);
  return { from, to, lines: shown, above: count(({ value }) => value > to), below: count(({ value }) => value < from) };
}

/** Bounds of one number and sign as one, with the names of their properties, those that fail first. */
function merged(bounds, failing) {
  return [...Map.groupBy(bounds, ({ op, value }) => `${op} ${value}`)].map(([text, found]) => {
    const names = found.map(({ property }) => property).sort((one, other) => failing.has(other) - failing.has(one));
    const more = names.length > 1 ? ` +${names.length - 1}` : "";
    return { text: `${text}  ${names[0]}${more}`, value: Number(found[0].value), names, fails: failing.has(names[0]) };
  });
}
