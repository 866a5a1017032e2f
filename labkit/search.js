// Finds pages of the site by words: PAGES, [place, title, its words], stands before.
{
  const field = document.getElementById("labkit-search");
  const list = document.getElementById("labkit-found");
  const plain = (text) => text.toLowerCase();
  field.addEventListener("input", () => {
    const wanted = plain(field.value).split(/\s+/).filter((word) => word.length > 1);
    const score = ([, title, words]) => wanted.every((word) => `${plain(title)} ${words}`.includes(word))
      && 1 + wanted.filter((word) => plain(title).includes(word)).length;
    const found = wanted.length ? PAGES.map((page) => [score(page), page]).filter(([n]) => n) : [];
    found.sort((one, other) => other[0] - one[0]);
    const rows = found.slice(0, 20).map(([, [place, title]]) => {
      const link = Object.assign(document.createElement("a"), { href: place, textContent: title });
      const row = document.createElement("li");
      row.append(link);
      return row;
    });
    const none = document.createElement("li");
    none.textContent = "no page has all these words";
    list.replaceChildren(...(rows.length || !wanted.length ? rows : [none]));
  });
}
