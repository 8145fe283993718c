// What the page asks of its server: with the token of its own address, about one project at a time.

export const about = new URLSearchParams(location.search);

/** The address of what is asked for, with more to be said. */
export function address(what, more = {}) {
  return `${what}?${new URLSearchParams({ ...Object.fromEntries(about), ...more })}`;
}

/** Send a message, or a file; an answer that is none is an error with the server's reason. */
export async function post(what, content = {}, more = {}) {
  const file = content instanceof Blob, headers = file ? {} : { "Content-Type": "application/json" };
  return checked(await fetch(address(what, more), { method: "POST", headers, body: file ? content : JSON.stringify(content) }));
}

/** Get something, as `post` does. */
export async function get(what, more = {}) {
  return checked(await fetch(address(what, more)));
}

async function checked(answer) {
  if (answer.ok) return answer;
  const said = await answer.text(), { error } = said.startsWith("{") ? JSON.parse(said) : { error: said };
  throw new Error(error || `the server answers ${answer.status}`);
}
