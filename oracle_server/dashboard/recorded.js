// What a session says of the recording that it judges.

import { h } from "./dom.js";

/** The recording of a session, by its state, in words; null where it judges a robot. */
export function recordedNotes({ recording, status }) {
  if (!recording) return null;
  const { name, complete, conclusion, read, total } = recording;
  const { unjudged = [], notes = [], warnings = [] } = conclusion ?? {};
  const going = total ? `, judged so far: ${Math.floor((100 * read) / total)} %.` : ", which is being judged.";
  const part = status === "open" ? going : h("span", { class: "complaint" }, ", of which only a part was judged.");
  const said = [...unjudged.map((each) => `${each.property} was not judged: ${each.reason}`), ...notes, ...warnings];
  return [
    h("p", {}, "The recording ", h("strong", {}, name), complete ? ", judged to its end." : part),
    ...said.map((each) => h("p", { class: "hint" }, each)),
  ];
}
