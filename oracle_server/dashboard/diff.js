// The lines in which two texts differ.

const MOST = 4_000_000; // pairs of lines that are compared with each other
const AROUND = 3; // lines shown before and after those that differ

/** The lines of both texts, in order, as `{sign, text}`: " " in both, "-" in the old one alone, "+" in the new one. */
export function differing(old, now) {
  const a = lines(old), b = lines(now);
  let head = 0, tail = 0;
  while (head < a.length && head < b.length && a[head] === b[head]) head += 1;
  while (tail < a.length - head && tail < b.length - head && a.at(-1 - tail) === b.at(-1 - tail)) tail += 1;
  return [
    ...signed(" ", a.slice(0, head)),
    ...compared(a.slice(head, a.length - tail), b.slice(head, b.length - tail)),
    ...signed(" ", a.slice(a.length - tail)),
  ];
}

/** Runs of these lines around what differs; `null` stands for what is left out. */
export function shortened(rows) {
  const near = rows.map(() => false);
  rows.forEach(({ sign }, i) => sign !== " " && near.fill(true, Math.max(0, i - AROUND), i + AROUND + 1));
  const shown = [];
  rows.forEach((row, i) => {
    if (near[i]) shown.push(row);
    else if (shown.at(-1) !== null) shown.push(null);
  });
  return shown;
}

function lines(text) {
  return text === "" ? [] : text.replace(/\n$/, "").split("\n");
}

function signed(sign, texts) {
  return texts.map((text) => ({ sign, text }));
}

/** By the longest common subsequence, unless the texts are too long for that. */
function compared(a, b) {
  if (a.length * b.length > MOST) return [...signed("-", a), ...signed("+", b)];
  const width = b.length + 1;
  const common = new Uint32Array((a.length + 1) * width);
  for (let i = a.length - 1; i >= 0; i -= 1) {
    for (let j = b.length - 1; j >= 0; j -= 1) {
      const next = (i + 1) * width + j;
      common[i * width + j] = a[i] === b[j] ? common[next + 1] + 1 : Math.max(common[next], common[i * width + j + 1]);
    }
  }
  const rows = [];
  let i = 0, j = 0;
  while (i < a.length || j < b.length) {
    if (i < a.length && j < b.length && a[i] === b[j]) rows.push({ sign: " ", text: a[i] }), i += 1, j += 1;
    else if (j >= b.length || (i < a.length && common[(i + 1) * width + j] >= common[i * width + j + 1])) rows.push({ sign: "-", text: a[i] }), i += 1;
    else rows.push({ sign: "+", text: b[j] }), j += 1;
  }
  return rows;
}
