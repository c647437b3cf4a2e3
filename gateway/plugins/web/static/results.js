// What became of a command, in words: nothing is shown as done before the gateway says so.

import { command } from "./api.js";
import { h } from "./dom.js";
import { store, titleOf } from "./store.js";

const SHOWN_MS = { good: 8000, other: 30000 };
const MOST = 5;
const LATE_MS = 3000;
const UNKNOWN = "no answer yet: it is not known whether it arrived. Look at the motor, use the local stop.";
const place = document.getElementById("results");

function show(title, isQuiet) {
  const phases = h("span", { class: "phases" }, "sent …");
  const close = h("button", { type: "button", class: "plain", "aria-label": "Close this result" }, "✕");
  const note = h("div", { class: "toast" }, h("strong", {}, title), phases, close);
  close.addEventListener("click", () => note.remove());
  place.append(note);
  while (place.children.length > MOST) place.firstElementChild.remove();
  const late = isQuiet ? null : setTimeout(() => {
    phases.textContent = UNKNOWN;
    note.className = "toast bad";
  }, LATE_MS);
  return (text, kind, stays = false) => {
    clearTimeout(late);
    phases.textContent = text;
    note.className = `toast ${kind}`;
    if (kind === "quiet") note.remove();
    else if (stays) return () => note.remove();
    else setTimeout(() => note.remove(), SHOWN_MS[kind] ?? SHOWN_MS.other);
  };
}

/** Says something until it is closed, for some time, or until what this returns is called. */
export function notice(title, text, forMs = null) {
  const remove = show(title, true)(text, forMs ? "refused" : "bad", true);
  if (forMs) setTimeout(remove, forMs);
  return remove;
}

const KINDS = { confirmed: "good", rejected: "refused", failed: "bad", unconfirmed: "bad" };

/** Gives a command, shows its end (`isQuiet`: only a bad one), and returns the final phase; null when it is not known. */
export async function carryOut(starter, verb, { isQuiet = false, ...options } = {}) {
  const end = show(`${verb.replaceAll("_", " ")} ${titleOf(starter, store.groups[starter] ? "groups" : "starters")}`, isQuiet);
  try {
    const { phases, final } = await command(starter, verb, options);
    if (!final) {
      end(`${phases.map((phase) => phase.phase).join(", ")} – no final result yet; look at the starter`, "bad");
      return null;
    }
    const ladder = phases.map((phase) => phase.phase).join(" → ");
    const code = final.code && final.code !== "ok" && final.code !== final.phase ? ` [${final.code}]` : "";
    const kind = KINDS[final.phase] ?? "";
    const members = Object.entries(final.members ?? {}).map(([name, each]) => `\n${titleOf(name)}: ${each.phase}${each.code === "ok" ? "" : ` [${each.code}]`}`);
    end(`${ladder}${code}: ${final.text ?? ""}${members.join("")}`, isQuiet && kind === "good" ? "quiet" : kind);
    return final;
  } catch (error) {
    const isUnknown = error.isUnknown || error.name === "TimeoutError" || error.name === "TypeError";
    end(isUnknown ? UNKNOWN.replace("yet", error.isUnknown ? "from the gateway" : "at all") : `not carried out: ${error.message}`, "bad");
    return null;
  }
}
