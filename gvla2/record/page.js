(() => {
  const box = document.getElementById("zoom");
  if (!box || !box.showModal) return;
  const inside = box.querySelector("img");
  const open = (picture) => { inside.src = picture.src; inside.alt = picture.alt; box.showModal(); };
  document.querySelectorAll("img[data-zoom]").forEach((picture) => {
    picture.tabIndex = 0;
    picture.addEventListener("click", () => open(picture));
    picture.addEventListener("keydown", (event) => { if (event.key === "Enter") open(picture); });
  });
  box.addEventListener("click", () => box.close());
})();
