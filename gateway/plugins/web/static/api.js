// Requests to the gateway; every failure is an Error with words for a person.

import { sessionEnded, store } from "./store.js";

const READ_WITHIN_MS = 8000; // a browser has six connections to a host: what is not answered must not hold a STOP back

export async function get(path) {
  return answered(await fetch(path, { headers: { Accept: "application/json" }, cache: "no-store", signal: AbortSignal.timeout(READ_WITHIN_MS) }));
}

export async function post(path, body = {}, { withinMs = 30000 } = {}) {
  const headers = { "Content-Type": "application/json" };
  if (store.session.csrf) headers["X-CSRF-Token"] = store.session.csrf;
  const options = { method: "POST", headers, body: JSON.stringify(body), signal: AbortSignal.timeout(withinMs) };
  return answered(await fetch(path, options));
}

async function answered(response) {
  let data;
  try {
    data = await response.json();
  } catch {
    const error = new Error(`The answer ${response.status} is not the gateway's.`);
    error.isUnknown = true; // a proxy's: what was asked for may have arrived all the same
    throw error;
  }
  if (!response.ok) {
    const error = new Error(data.text ?? data.error ?? `error ${response.status}`);
    error.code = data.error;
    if (data.error === "login") sessionEnded();
    throw error;
  }
  return data;
}

const COMMAND_WITHIN_MS = 15000; // the gateway answers within 12 s, with or without the end

function newId() {
  const bytes = crypto.getRandomValues(new Uint8Array(12));
  return `web-${Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("")}`;
}

/** Gives a command and returns its phases; the last one is final, or its outcome is unknown. */
export async function command(starter, verb, { args = {}, expect, select } = {}) {
  const body = verb === "stop" ? {} : { id: newId(), token: store.token, ttl_s: 10, args };
  if (expect) body.expect = expect;
  if (select) body.select = select;
  const path = `api/v1/command/${encodeURIComponent(starter)}/${encodeURIComponent(verb)}`;
  const { phases, final } = await post(path, body, { withinMs: COMMAND_WITHIN_MS });
  return { phases, final: final ? phases.at(-1) : null };
}
