// The token that the printed address holds.

/** Takes the token out of the address, so that no history, bookmark or screenshot keeps it. The entry of this tab in its
 * history holds it instead: the page can be loaded again, and no other origin can read it. Returns "token=…". */
export function takeToken(): string {
  const here = new URL(location.href);
  const token = here.searchParams.get("token") ?? (history.state as { token?: string } | null)?.token ?? "";
  here.searchParams.delete("token");
  history.replaceState({ token }, "", here);
  return `token=${encodeURIComponent(token)}`;
}

/** Addresses of the scene and the socket. */
export function addresses(query: string): [scene: string, socket: string] {
  const secure = location.protocol === "https:" ? "wss" : "ws";
  return [`${location.origin}/scene?${query}`, `${secure}://${location.host}/socket?${query}`];
}
