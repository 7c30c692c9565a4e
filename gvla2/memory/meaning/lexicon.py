"""Words of one meaning, words that forbid, that order and that say nothing: English, German, French, Spanish, Chinese.

A language that is missing loses the oppositions between words; numbers and typed effects are still compared.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from gvla2.memory.meaning.opposites import OPPOSITES
from gvla2.memory.meaning.phrases import join_phrases as join_phrases
from gvla2.memory.meaning.word_sets import word_set

_SAME = """
turn: turn turns turned turning rotate rotates rotated rotating rotation twist twisting spin spun drehe drehen dreht
    gedreht tournez tourner tourne gira girar gire rota rotar ruota girare поверни 旋转 转动 转 拧
place: place places placed placing put puts putting lay laid lege legen legt gelegt stelle stellen gestellt posez
    poser pose mettre mettez coloca colocar coloque pon poner ponga metti posa положи поставь 放 放置 摆放
go: move moves moved moving go goes went gone drive drives driving drove driven travel bewege bewegen bewegt fahre
    fahren fährt gefahren déplacez déplacer déplace bouge bouger mueve mover mueva conduce conducir muovi двигай
    移动 行驶
throw: throw throws threw thrown toss tossed werfe werfen wirf lancer lancez lanza lanzar 扔 投
cup: cup cups mug mugs tasse tassen taza tazas becher gobelet 杯子 杯
box: box boxes kiste kisten schachtel boîte boîtes caja cajas scatola caixa коробку 盒子 箱子
door: door doors tür türen porte portes puerta puertas porta дверь 门
drawer: drawer drawers schublade schubladen tiroir tiroirs cajón cajones 抽屉
window: window windows fenster fenêtre fenêtres ventana ventanas окно 窗户 窗
lid: lid lids deckel couvercle tapa tapas 盖子 瓶盖
glass: glass glasses glas gläser verre verres vaso vasos 玻璃杯
plate: plate plates teller assiette assiettes plato platos 盘子
bowl: bowl bowls schüssel schale bol bols cuenco 碗
bottle: bottle bottles flasche flaschen bouteille bouteilles botella botellas 瓶子
kettle: kettle wasserkocher bouilloire hervidor 水壶
pot: pot pots topf töpfe casserole olla ollas 锅
table: table tables tisch tische mesa mesas стол 桌子
shelf: shelf shelves regal étagère étagères estante estantes 架子 书架
screw: screw screws schraube schrauben vis tornillo tornillos 螺丝 螺钉
key: key keys schlüssel clé clés clef llave llaves 钥匙
valve: valve valves ventil ventile vanne vannes válvula válvulas 阀门 阀
pump: pump pumps pumpe pumpen pompe pompes bomba bombas 泵
lamp: lamp lamps lampe lampen lampes lámpara lámparas 灯 台灯
handle: handle handles griff griffe poignée poignées manija asa 把手 手柄
cube: cube cubes block blocks würfel bloc blocs bloque bloques cubo cubos 方块 积木 块
book: book books buch bücher livre livres libro libros 书
camera: camera cameras kamera kameras caméra caméras cámara cámaras 相机 摄像头
motor: motor motors motoren moteur moteurs motores 电机 马达
robot: robot robots roboter 机器人
image: image images picture pictures photo photos bild bilder foto fotos imagen imágenes 图像 照片
middle: middle centre center centres centers mitte milieu centro 中间 中心 中央
colour: colour color colours colors farbe couleur 颜色
gripper: gripper grippers greifer pince pinces pinza pinzas garra захват 夹爪 夹具
button: button buttons knopf knöpfe taste bouton boutons botón botones 按钮
file: file files datei dateien fichier fichiers archivo archivos 文件
adjacent: adjacent neighbouring neighboring benachbart voisin adyacente 相邻
check: check checks checked checking verify verifies verified inspect inspected prüfe prüfen überprüfen prüft
    vérifiez vérifier vérifie verifica verificar comprueba comprobar 检查 确认
touch: touch touches touched touching contact berühre berühren berührt touchez toucher toca tocar toque 触碰 触摸
    接触
press: press presses pressed pressing appuyer appuyez presiona presionar pulsa pulsar 按 按下 按压
wait: wait waits waiting rest rests warte warten wartet attendez attendre attends espera esperar espere 等待 等
cook: cook cooks cooking koche kochen kocht cuire cuisez cocina cocinar 煮 烹饪
descend: descend descends descent abstieg descendre descendez descente descender 下降
run: run runs running execute executes executed ran ausführen exécuter exécutez ejecuta ejecutar 运行 执行
directory: folder directory directories folders ordner verzeichnis dossier répertoire carpeta directorio 文件夹 目录
error: error errors failure fault fehler erreur erreurs fallo 错误
speedof: speed velocity geschwindigkeit vitesse velocidad 速度
"""

SOFT = word_set(
    """
    set use uses used using make makes sure keep keeps keeping kept leave leaves get gets give take takes need needs
    needed must should shall always please better best good works work worked working succeed succeeded succeeds
    success fails failed ensure carefully properly safely exactly about around roughly approximately just simply
    prefer preferably recommended ideally usually often sometimes generally really amount value figure setting way
    side direction movement motion approx least most than per each every total own once again still there here well even
    fine enough okay ought having worth plenty suffices toward towards upon via along across onto deep deeply while
    during being been gets
    lasse lassen verwende verwenden benutze benutzen nutze nutzen immer stets bitte muss müssen soll sollte sollen
    hat haben hatte habt darf dürfen werden wird worden beim beträgt betragen kommt gehört gilt lässt sich dass
    funktioniert vorher nachher dabei jeweils richtung seite etwas
    utilisez utiliser utilise toujours doit doivent faut il mettre mettez mets laisse laissez fait faire côté direction
    vers jusque vaut valoir être reste rester suffit
    usa usar use utiliza utilizar siempre debe deben hay hacia lado deja dejar haz hacer tener tiene tienen tenga
    estar está están mantén mantener mantenga vale basta
    把 将 向 往 从 朝 用 使用 的 了 着 请 应 应该 必须 总是 要 需要 对 在 给 让 到 和 与 则 就 边 侧 时 个 设为
    设成 设置为 设定为 设定 调到 调为 才能 可以 有 是
    """
)
"""Words that change nothing about what is done to what."""

CONDITIONS = word_set(
    "if when whenever while unless until once during falls wenn sobald während solange bis quand lorsque si pendant "
    "tant cuando mientras hasta 如果 当 若 当时"
)
"""What follows them says under which circumstances, not what to do."""

BEFORE = word_set("before prior vor bevor ehe avant antes перед 之前 以前 前先")
AFTER = word_set("after afterwards nach nachdem après después tras dopo depois после 之后 以后")
THEN = word_set(
    "then afterwards next subsequently finally lastly danach dann anschließend schließlich zuletzt puis ensuite enfin "
    "luego entonces finalmente poi depois затем потом 再 然后 接着 最后 随后"
)
FIRST = word_set("first firstly zuerst zunächst erst d'abord abord primero primeiro сначала 先 首先")

NEGATORS = word_set(
    """
    not never no don't dont doesn't mustn't shouldn't can't cannot won't avoid avoids avoiding refrain without
    nicht nie niemals kein keine keinen keinem keiner keines vermeide vermeiden ohne
    ne n pas jamais aucun aucune évitez éviter évite sans
    nunca jamás evita evitar evite sin
    non mai não не никогда нельзя
    不要 别 勿 切勿 禁止 避免 不能 不可 不得 从不 绝不 不 不应 不应该 没有 
    """
)
"""A clause with one of these forbids what it says; :data:`gvla2.memory.meaning.sentences.IDIOMS` do not."""

TURNING = word_set("turn turns turned turning switch switched switching power powered leave")
STAYING = word_set("keep keeps keeping stay stays remain remains")
IDENTIFIERS = word_set(
    "step way line waypoint table example case lesson episode run seed code object item no number figure page chapter "
    "layer joint row column stage task issue test version option variant schritt zeile beispiel schritt ligne étape "
    "paso línea ejemplo 第 步 行"
)
"""A bare number after one of these names a thing and measures nothing."""

PARTICLE_VERBS = word_set(
    "pick set clean look put lay speed slow back write warm heat cool grow clear close wash"
)
"""With these, "up" and "down" are part of the verb."""

PLACES = word_set(
    "side hand arm gripper finger direction lane edge end corner half part way speed temperature water heat level rate "
    "pressure order priority seite hand arm richtung main bras côté mano brazo lado"
)
"""Before these, "the left" is where or how; before any other noun it says which one."""

DETERMINERS = word_set(
    "the a an this that its your each die der das den dem eine einen le la les el los las un una"
)

NOUNS = word_set(
    "start end stop lock load cover lift push pull pin dock charge block tie clamp clip seal plug wrap fold show split "
    "register release grip drain spread stretch link commit catch pinch freeze hold drop heat cool switch pack "
    "contract buckle stack display select upgrade upload download wind roll import export"
)
"""English acts that are things as well ("at the start"): acts only behind :data:`BEFORE_VERBS`."""

BEFORE_VERBS = word_set(
    "to must should shall can may will would and or then but not never always please only just first finally , don't "
    "doesn't cannot can't do does let it they you we before after when while if once until without by"
)
"""Where a verb may stand behind; at the beginning of a clause it may as well."""


def _table(text: str) -> tuple[dict[str, str], dict[str, tuple[str, int]]]:
    words: dict[str, str] = {}
    poles: dict[str, tuple[str, int]] = {}
    for line in text.strip().replace("\n    ", " ").split("\n"):
        name, _, rest = line.partition(":")
        groups = rest.split("/")
        for index, group in enumerate(groups):
            concept = f"{name}{'+-'[index]}" if len(groups) == 2 else name
            if len(groups) == 2:
                poles[concept] = (name, 1 - 2 * index)
            for word in group.casefold().split():
                words.setdefault(word, concept)
    return words, poles


_opposite_words, _poles = _table(OPPOSITES)
_same_words, _ = _table(_SAME)
CONCEPTS: Mapping[str, str] = MappingProxyType({**_same_words, **_opposite_words})
"""Word -> the concept that it stands for, "axis+" or "axis-" where it has an opposite."""

POLES: Mapping[str, tuple[str, int]] = MappingProxyType(_poles)
"""Concept -> its axis and side."""

SEGMENTS: frozenset[str] = frozenset(
    word
    for words in (CONCEPTS, SOFT, CONDITIONS, BEFORE, AFTER, THEN, FIRST, NEGATORS)
    for word in words
    if "\u3400" <= word[0] <= "\u9fff"
)
"""The Chinese words of all the lists: scripts without spaces are cut by the longest of them."""
