// The address of what is shown, to be sent to somebody else.

import { h } from "./dom.js";

const SAID = 2_000; // ms

/** A button that copies the address that `address()` gives, with the part of time that is in view, even where this follows the newest steps. */
export function linkButton(address) {
  const button = h("button", { type: "button", class: "link", onclick: copy }, "Copy link");
  const told = h("span", { class: "unseen", "aria-live": "polite" });

  async function copy() {
    const text = new URL(address(), location.href).href;
    const copied = await (navigator.clipboard?.writeText(text) ?? Promise.reject(new Error("no clipboard"))).then(() => true, () => selected(text));
    button.textContent = copied ? "Copied" : "Not copied";
    told.textContent = copied ? "The address is copied." : "The browser does not let the address be copied.";
    setTimeout(() => ([button.textContent, told.textContent] = ["Copy link", ""]), SAID);
  }

  return h("span", {}, button, told);
}

/** Copy a text as one does by hand: pages that are not secure (http beside this machine) have no other way. */
function selected(text) {
  const field = h("textarea", { class: "unseen" });
  field.value = text;
  document.body.append(field);
  field.select();
  const copied = document.execCommand("copy");
  field.remove();
  return copied;
}
